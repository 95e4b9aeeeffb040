"""The domain of a file, and its content."""

from __future__ import annotations

import sys
from argparse import Namespace

import numpy as np
from mpi4py import MPI

from rigidfx.command.at_rest import is_at_rest
from rigidfx.command.options import CAD, GEO
from rigidfx.command.parser import RankParser, say
from rigidfx.domain.cad import list_cad, read_cad
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import read_msh
from rigidfx.domain.gmsh_script import read_geo
from rigidfx.domain.inp import read_inp

__all__ = ["read"]


def read(parser: RankParser, options: Namespace) -> Domain:
    """The domain of the file, whose names are printed. Collective.

    The command ends here if it has only to show the file, or nothing is held or loaded: a free part
    has a description and modes, but no equilibrium and no run.
    """
    if options.list and options.kind in CAD:
        say(str(list_cad(options.file, scale=options.scale)))
        sys.exit(0)
    domain = _domain(options)
    cells = domain.mesh.topology.index_map(3).size_global
    x = np.concatenate(MPI.COMM_WORLD.allgather(domain.mesh.geometry.x))
    size = " × ".join(f"{extent:.4g}" for extent in np.ptp(x, axis=0))
    say(f"{options.file}: {cells} cells, {size} m; names: {domain.names}")
    nothing = not (options.hold or options.load or options.gravity)
    missing = "Say what is held and loaded: --hold NAME --load NAME FX FY FZ. See also --help."
    if nothing and (options.static or options.t_end is not None):
        parser.error(missing)
    if nothing and not is_at_rest(options):
        say(missing)
        sys.exit(0)
    if options.list:
        sys.exit(0)
    if options.t_end is None and not is_at_rest(options):
        parser.error("--t-end is missing: how long is the run [s]? Or take --static or --modes.")
    return domain


def _domain(options: Namespace) -> Domain:
    path, size, scale = options.file, options.size, options.scale
    curved, order = options.curved, 2 if options.curved else 1
    if options.kind in CAD:
        surfaces = {
            name: [int(n) if n.isdecimal() else n for n in numbers.split(",")]
            for name, numbers in options.surfaces.items()
        }
        per_circle = options.per_circle or 0.0
        return read_cad(
            path, surfaces=surfaces, size=size, scale=scale, per_circle=per_circle, order=order
        )
    if options.kind in GEO:
        parameters = {name: _value(text) for name, text in options.parameters.items()}
        return read_geo(path, parameters, size=size, scale=scale, order=order if curved else None)
    if options.kind == ".inp":
        corners, encoding = options.corners, options.encoding
        return read_inp(path, scale=scale, corners=corners, encoding=encoding)
    return read_msh(path, scale=scale)


def _value(text: str) -> float | str:
    """A number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text
