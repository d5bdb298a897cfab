"""A digital twin, in Drake, of NASA's PIPS serpentine arm and the machines around it.

Importing this package imports nothing else, so that the command line starts at once; import the
module that is needed, for example `pips_drake.serpentine.kinematics`.
"""

from importlib import metadata

try:
    __version__ = metadata.version("pips-drake")
except metadata.PackageNotFoundError:  # a checkout that was never installed
    __version__ = "0+unknown"

__all__ = ["__version__"]
