"""The command `rigidfx`: simulates a mesh, a script of gmsh or a CAD file, without any Python.

    rigidfx part.step --list
    rigidfx part.step --name wall=3,4 --name end=7 --size 0.005 --E 7e10 --rho 2700 \
        --hold wall --load end 0 0 -200 --until 0.002 --dt 1e-4 --t-end 0.05

`python3 -m rigidfx.command` is the same where the package is not installed. Its parts serve scripts
that take options of their own: `demos/custom_geometry.py` is one.
"""

from rigidfx.command.main import main
from rigidfx.command.options import Example

__all__ = ["Example", "main"]
