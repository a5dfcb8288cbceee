"""Where solutions leave the program: edge units, NMEA 0183, Zenoh and the files of a replay."""
