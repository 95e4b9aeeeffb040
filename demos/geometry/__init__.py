"""What `custom_geometry.py` is told on the command line, and what it makes of a file."""

from .acting import supports_and_loads
from .options import ask
from .reading import read
from .told import told

__all__ = ["ask", "read", "supports_and_loads", "told"]
