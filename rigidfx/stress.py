"""Former place of `rigidfx.flexible.stress`; it goes with the next release."""

import warnings

from rigidfx.flexible.stress import *  # noqa: F403
from rigidfx.flexible.stress import __all__ as __all__

warnings.warn(
    "rigidfx.stress has moved to rigidfx.flexible.stress.",
    DeprecationWarning,
    stacklevel=2,
)
