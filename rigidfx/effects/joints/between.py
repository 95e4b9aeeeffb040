"""Effects between two sides: joints, and springs between two points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.effects.base import WHOLE, Effect
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.sides import GROUND, Side, Surface, check_side, side_name

__all__ = ["Between"]


@dataclass(frozen=True)
class Between(Effect):
    """Something between two sides, in the whole run.

    Attributes:
        a: First side.
        b: Second side.
        name: Its name in reports; kind and sides if None.
    """

    many: ClassVar[str] = "joints"  # its kind, for messages
    named: ClassVar[str] = "the name of a Rigid part"  # a side that is a text, likewise

    a: Side
    b: Side
    name: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check name and sides.

        Raises:
            SceneError: If one of them cannot be used, or both sides are the same.
        """
        super().__post_init__()
        if self.name is not None and (not isinstance(self.name, str) or not self.name):
            raise SceneError(f"{self.kind}: name must be a text, got {shown(self.name)}.")
        for name in ("a", "b"):
            check_side(self.kind, name, getattr(self, name), self.named)
        same = isinstance(self.a, Surface) and isinstance(self.b, Surface)
        if self.a == self.b or (same and self.joins[0] == self.joins[1]):
            raise SceneError(
                f"{self.owner}: both sides are the same. A {self.kind} is between two parts, or "
                f"one and the '{GROUND}'."
            )

    @property
    def title(self) -> str:
        """Its name in reports."""
        return self.name or f"{self.kind} {self.between}"

    @property
    def between(self) -> str:
        """Its sides in words."""
        return f"{side_name(self.a)} - {side_name(self.b)}"

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return self.title if self.name is None else f"{self.kind} '{self.name}'"

    @property
    def sides(self) -> tuple[Side, Side]:
        """Both sides, as they were given."""
        return self.a, self.b

    @property
    def averages(self) -> Sequence[Vector]:
        """Places and directions that it acts on, once a scene has placed it."""
        raise NotImplementedError

    @property
    def holds(self) -> bool:  # type: ignore[override]
        """Whether one side is the ground."""
        return GROUND in (self.a, self.b)

    @property
    def where(self) -> str | None:
        """Set of the first side that is not the ground; None means all cells."""
        return self.joins[0]

    @property
    def joins(self) -> tuple[str | None, ...]:
        """The sets of its sides."""
        sides = (s.where if isinstance(s, Surface) else s for s in self.sides)
        return tuple(None if where == WHOLE else where for where in sides if where != GROUND)

    def check_title(self, scene: Any) -> None:
        """See whether no other one has its title.

        Raises:
            SceneError: If one has.
        """
        if [other.title for other in scene.named(Between)].count(self.title) > 1:
            raise SceneError(
                f"{self.owner}: two {self.many} are called '{self.title}'; give one a name of its "
                "own."
            )
