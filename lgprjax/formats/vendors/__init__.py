"""Readers of other instruments and programs: line files of four makers, SEG-Y, gprMax, open data sets."""
