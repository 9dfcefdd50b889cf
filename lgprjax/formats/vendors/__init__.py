"""Readers of instruments and programs that are not ours: line files of four makers, SEG-Y, gprMax, open data sets."""
