"""What may act in a scene: loads, supports, damping, initial motion, preload, rigid parts.

Every effect is a frozen record in SI units with a time window and knows at which instants it
changes abruptly; steps end exactly there. An effect that a scene does not name adds nothing to the
compiled forms.
"""

from rigidfx.effects.base import Effect, Table, Windowed
from rigidfx.effects.loads import BodyForce, DeadLoad, Gravity, NodalForce, Resultant, Traction
from rigidfx.effects.motion import InitialVelocity, NumericalDamping, Preload, Rigid
from rigidfx.effects.supports import Fixed, PrescribedMotion, Support

__all__ = [
    "BodyForce",
    "DeadLoad",
    "Effect",
    "Fixed",
    "Gravity",
    "InitialVelocity",
    "NodalForce",
    "NumericalDamping",
    "Preload",
    "PrescribedMotion",
    "Resultant",
    "Rigid",
    "Support",
    "Table",
    "Traction",
    "Windowed",
]
