"""The suite's one site, map, course, field and vehicle; each is made once a session and shared by all workers.

Two sets of array shapes serve the whole suite, since compiling is most of its time: the *site* (11 channels, 40 m of
road) for everything that registers, and the *small map* (5 channels, 40 samples) for files. A test that needs another
shape says why.
"""
