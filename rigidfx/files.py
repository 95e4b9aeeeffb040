"""Former place of `rigidfx.base.text_files`; it goes with the next release."""

import warnings

from rigidfx.base.text_files import *  # noqa: F403
from rigidfx.base.text_files import __all__ as __all__

warnings.warn(
    "rigidfx.files has moved to rigidfx.base.text_files.",
    DeprecationWarning,
    stacklevel=2,
)
