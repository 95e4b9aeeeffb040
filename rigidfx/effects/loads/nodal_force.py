"""Dead loads on nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rigidfx.effects.base import Array, Vector
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["NodalForce"]


@dataclass(frozen=True)
class NodalForce(DeadLoad):
    """A total force spread in equal parts over the nodes of a named set.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        value: Three components of the *total* force [N], or a function of time giving them.
    """

    dims: ClassVar[tuple[int, ...]] = (2, 3, 1, 0)

    where: str
    value: Vector | Callable[[float], Vector]

    def weights(self, scene: Any) -> Array:
        """Share of each node [1]."""
        return scene.shares(self.where, self.kind)
