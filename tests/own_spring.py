"""The spring of docs/extending.md, between blocks that are flexible, rigid, or held at faces.

As a script under mpirun: report what the ranks find.
"""

import re
import warnings
from pathlib import Path

import numpy as np
from mpi4py import MPI
from parallel import report
from scipy.optimize import brentq

import rigidfx as rf

PAGE = Path(__file__).resolve().parent.parent / "docs" / "extending.md"
code = re.search(r"```python\n(from copy.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
exec(compile(code[1], str(PAGE), "exec"), globals())

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
K, CUBIC = 2e4, 4e5
ENDS = {
    "flexible": ("a", "b", ()),
    "bodies": ("a", "b", (rf.Rigid("left"), rf.Rigid("right"))),
    "a body and a mean face": ("a", rf.MeanFace("b"), (rf.Rigid("left"),)),
    "rigid faces": (rf.RigidFace("a"), rf.RigidFace("b"), ()),
}


def energy(q):
    """Of a spring that is stiffer the longer it is; without force at 1 m."""
    return 0.5 * K * (q - 1.0) ** 2 + 0.25 * CUBIC * (q - 1.0) ** 4


def blocks(name, *effects, **options):
    """Two blocks, each of two cells, with a spring between them along x."""
    unit = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1, 2)], dtype=float)
    cells = np.array([[k, k + 1, k + 3, k + 4, k + 6, k + 7, k + 9, k + 10] for k in (0, 1)])
    points = np.vstack([unit, unit + np.array([3.0, 0.0, 0.0])])
    own = slice(None) if MPI.COMM_WORLD.rank == 0 else slice(0)
    domain = rf.from_arrays(points[own], np.vstack([cells, cells + 12])[own], "hexahedron")
    domain = domain.with_cells("left", lambda x: x[0] < 2.1).with_cells(
        "right", lambda x: x[0] > 2.9
    )
    domain = domain.with_facets("a", lambda x: np.isclose(x[0], 2))
    domain = domain.with_facets("b", lambda x: np.isclose(x[0], 3))
    domain = domain.with_facets("foot", lambda x: np.isclose(x[0], 0))
    domain = domain.with_facets("far", lambda x: np.isclose(x[0], 5))
    a, b, parts = ENDS[name]
    spring = OwnSpring(a, b, energy)  # noqa: F821 - of the page
    return rf.Scene(domain, SOFT, [spring, *parts, *effects], **options)


def history(name="a body and a mean face"):
    """Energy and momenta of blocks that fly, at each step, one row each. Collective."""
    fly = rf.InitialVelocity(
        function=lambda x: np.array([1.0 * (x[0] > 2.5), 0.3 * x[0], 0 * x[0]])
    )
    reports = rf.simulate(blocks(name, fly), 0.01, 0.3)
    return [[r.energy, r.springs, *r.linear_momentum, *r.angular_momentum] for r in reports]


def straining():
    """Statics of a pull of 5 kN: energy in the spring over that of the exact length."""
    pull = rf.NodalForce("right", (5e3, 0.0, 0.0))
    held = rf.Fixed("foot"), rf.Spring("far", (1.0, 1e5, 1e5))
    *_, last = rf.static(blocks("rigid faces", *held, pull), 2)
    length = 1.0 + brentq(lambda x: K * x + CUBIC * x**3 - 5e3, 0.0, 1.0)
    return last.springs / energy(length)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    report(history())
