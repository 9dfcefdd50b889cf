"""Tests of lgprjax.formats. A package, so that the test files share ``samples``."""
