"""Effects on a geometry of one's own: supports, loads, gravity, damping."""

from __future__ import annotations

from argparse import Namespace

from rigidfx.effects import Fixed, Gravity, NumericalDamping, Traction
from rigidfx.effects.base import Effect

__all__ = ["supports_and_loads"]


def supports_and_loads(options: Namespace) -> list[Effect]:
    """The effects that the options name.

    A load is a total force over the area of its facets.
    """
    found: list[Effect] = [NumericalDamping(options.damping)] if options.damping else []
    for text in options.hold:
        name, _, components = text.partition(":")
        found.append(Fixed(name, components or "xyz"))
    for name, force in options.load:
        found.append(Traction(name, tuple(force), total=True, until=options.until))
    if options.gravity:
        found.append(Gravity(tuple(options.gravity)))
    return found
