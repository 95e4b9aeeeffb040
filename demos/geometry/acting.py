"""What acts on a geometry of one's own: supports, loads, gravity, damping."""

from __future__ import annotations

from argparse import Namespace

import dolfinx.mesh as dmesh
import numpy as np
import ufl
from common import Parser
from dolfinx import fem

import rigidfx as rf


def supports_and_loads(
    parser: Parser, options: Namespace, domain: rf.Domain, until: float
) -> list[rf.effects.Effect]:
    """The effects that the options name; loads end at a time [s]. Collective.

    A load is a total force; over the area of its facets it is a traction. Names that are not there
    are answered with those that are.
    """
    found: list = [rf.NumericalDamping(options.damping)] if options.damping else []
    for text in options.hold:
        name, _, components = text.partition(":")
        found.append(rf.Fixed(name, components or "xyz"))
    for name, force in options.load:
        area = _area(domain, name, options.order)
        if area == 0:
            parser.error(f"--load {name}: its facets lie inside the mesh; it needs boundary facets")
        found.append(rf.Traction(name, tuple(force / area), until=until))
    if options.gravity:
        found.append(rf.Gravity(tuple(options.gravity)))
    return found


def _area(domain: rf.Domain, name: str, order: int) -> float:
    """Area of named facets of the boundary, straight or curved [m²]."""
    mesh = domain.mesh
    mesh.topology.create_connectivity(2, 3)
    outside = dmesh.exterior_facet_indices(mesh.topology)
    facets = np.intersect1d(domain.find(name, (2,), "--load").entities, outside)
    tags = dmesh.meshtags(mesh, 2, facets, np.ones_like(facets))
    # by the rule of `Traction`, so that the force is right to rounding
    rule = {"quadrature_degree": 2 * order + 2}
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=tags, metadata=rule)
    one = fem.Constant(mesh, 1.0)
    return mesh.comm.allreduce(fem.assemble_scalar(fem.form(one * ds(1))))
