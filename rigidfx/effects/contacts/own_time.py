"""The shortest time in which a contact closes and opens: that of one node on its penalty stiffness.

A node of mass m that hits a penalty of stiffness k leaves it after half a period, π √(m/k). Steps
that are short against this time resolve every force of the contact, whatever the body does. A part
that is named rigid has its whole mass on the stiffness of all its nodes in the surface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.effects.contacts.surface import surface_of
from rigidfx.effects.rigid import Rigid

__all__ = ["own_time"]

Array = npt.NDArray[np.float64]


def own_time(scene: Any, contact: Any) -> float:
    """The least π √(m/k) of the nodes and rigid parts of a contact [s]; inf if none. Collective.

    Where two surfaces meet, m is the mass of a node that moves against the lightest node of the
    other surface.

    Args:
        scene: The problem.
        contact: One of its contacts.
    """
    mass, other = _moving_masses(scene), np.inf
    surface = surface_of(scene, contact.where, contact.stiffness, contact.owner)
    if isinstance(contact.against, str):
        mate = surface_of(scene, contact.against, contact.stiffness, contact.owner)
        lightest = float(mass[mate.area > 0].min(initial=np.inf))
        other = scene.comm.allreduce(lightest, op=MPI.MIN)
    m, k = mass[surface.area > 0], surface.stiffness[surface.area > 0]
    with np.errstate(divide="ignore"):  # of two rigid nodes
        squares = 1.0 / ((1.0 / m + 1.0 / other) * k)
    least = scene.comm.allreduce(float(squares.min(initial=np.inf)), op=MPI.MIN)
    of_parts = (_of_part(scene, rigid, surface.stiffness, other) for rigid in scene.named(Rigid))
    return float(np.pi * np.sqrt(min([least, *of_parts])))


def _of_part(scene: Any, rigid: Rigid, stiffness: Array, other: float) -> float:
    """m/k of a part that is named rigid [s²]; inf if it has no node in the surface. Collective."""
    inside = np.zeros(stiffness.size, dtype=bool)
    inside[_inside(scene, rigid)] = True
    inside[scene.owned_nodes :] = False
    k, m = scene.sum([stiffness[inside].sum(), scene.nodal_mass[inside].sum()])
    m = m if rigid.mass is None else rigid.mass
    with np.errstate(divide="ignore"):
        return float(1.0 / ((1.0 / m + 1.0 / other) * k))


def _moving_masses(scene: Any) -> Array:
    """Masses of the local nodes, inf in parts named rigid, shape (nodes,) [kg]. Collective."""
    mass = scene.averaging_mass.copy()
    for rigid in scene.named(Rigid):
        mass[_inside(scene, rigid)] = np.inf
    return mass


def _inside(scene: Any, rigid: Rigid) -> Any:
    """Local nodes of a part that is named rigid. Collective."""
    return slice(None) if rigid.where is None else scene.nodes(rigid.where, "Rigid", (3,))
