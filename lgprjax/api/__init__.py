"""The public interface behind ``import lgprjax as lx``: paths or open objects in, objects with a readable repr out.

A module here adapts what the other packages do to a caller in Python. ``lgprjax.api.page`` writes docs/api.md from the
docstrings.
"""
