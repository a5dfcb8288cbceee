"""LinkQuest TrackLink 1500, 5000 and 10000: the outputs of its topside program, one module each."""
