"""What may act in a scene: loads, supports, damping, attachments, initial motion, rigid parts.

Every effect is a frozen record in SI units with a time window and knows at which instants it
changes abruptly; steps end exactly there. An effect that a scene does not name adds nothing to the
compiled forms.
"""

from rigidfx.effects.attachments import PointMass, Spring
from rigidfx.effects.base import Effect, Table, Windowed
from rigidfx.effects.damping import Damping, KelvinVoigt, MassDamping, NumericalDamping
from rigidfx.effects.follower import Pressure
from rigidfx.effects.loads import BodyForce, DeadLoad, Gravity, NodalForce, Resultant, Traction
from rigidfx.effects.motion import InitialVelocity, Preload, Rigid
from rigidfx.effects.supports import Fixed, PrescribedMotion, Support

__all__ = [
    "BodyForce",
    "Damping",
    "DeadLoad",
    "Effect",
    "Fixed",
    "Gravity",
    "InitialVelocity",
    "KelvinVoigt",
    "MassDamping",
    "NodalForce",
    "NumericalDamping",
    "PointMass",
    "Preload",
    "PrescribedMotion",
    "Pressure",
    "Resultant",
    "Rigid",
    "Spring",
    "Support",
    "Table",
    "Traction",
    "Windowed",
]
