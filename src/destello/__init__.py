"""destello: a physically based path tracer."""

from destello._version import __version__ as __version__
