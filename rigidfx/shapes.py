"""Former place of `rigidfx.plot.shapes`; it goes with the next release."""

import warnings

from rigidfx.plot.shapes import *  # noqa: F403
from rigidfx.plot.shapes import __all__ as __all__

warnings.warn(
    "rigidfx.shapes has moved to rigidfx.plot.shapes.",
    DeprecationWarning,
    stacklevel=2,
)
