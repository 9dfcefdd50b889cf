"""lgprjax: localizing ground-penetrating radar on JAX.

Rooms, in the natural way of the data: ``formats`` (drive log) -> ``radar`` (profiles) -> ``subsurface`` (tiles)
-> ``registration`` (fixes, searched by ``pso``) -> ``report``. ``scene`` makes ground with a known truth.
"""

__version__ = "0.1.0"
