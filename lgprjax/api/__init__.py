"""The public interface behind ``import lgprjax as lx``: paths or open objects in, objects with a readable repr out.

The modules adapt the other packages for callers in Python. ``lgprjax.api.page`` writes the reference from docstrings.
"""
