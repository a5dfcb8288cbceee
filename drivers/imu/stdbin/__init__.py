"""iXblue and Exail STDBIN: the binary telegrams of PHINS, ROVINS, HYDRINS, OCTANS and their kin."""
