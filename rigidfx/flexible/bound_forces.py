"""Forms of the internal forces: compiled for the terms that act, and bound to cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dolfinx import fem

from rigidfx.flexible.kernels import Kernel


@dataclass(frozen=True)
class BoundForces:
    """Forms over the flexible cells and those of their facets that loads act on.

    Attributes:
        residual: Force vector.
        interior: Its derivative by the unknown displacement, over cells that touch no rigid body.
        interface: The same over those that do.
        undeformed: Both derivatives where nothing is displaced, whatever the coefficients hold.
    """

    residual: fem.Form
    interior: fem.Form
    interface: fem.Form
    undeformed: tuple[fem.Form, fem.Form]


@dataclass(frozen=True)
class Taken:
    """Energy that terms of the forms take out of the motion in a step [J].

    Attributes:
        dissipated: By each kind of damping.
        against_loads: Forces of cells against loads; no form if there are none.
    """

    dissipated: Mapping[str, fem.Form]
    against_loads: Sequence[fem.Form]


@dataclass(frozen=True)
class Variant:
    """Compiled forms of a step with the terms that act at a time.

    Attributes:
        residual: Virtual work.
        tangent: Its derivative by the unknown displacement.
        dissipated: Energy that damping takes in a step [J], by the kind of damping.
        against_loads: Energy that goes into loads on facets [J].
    """

    residual: Kernel
    tangent: Kernel
    dissipated: Mapping[str, Kernel]
    against_loads: Kernel | None
