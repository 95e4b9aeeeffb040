"""What may act in a scene: loads, supports, damping, attachments, initial motion, rigid parts.

Every effect is a frozen record in SI units, in a file of its own with its forces, and knows at
which instants it changes abruptly; steps end exactly there. An effect that a scene does not name
adds nothing to the compiled forms, and no action to a step: see `action`.
"""

from rigidfx.effects.action import Action, FormTerm, Structure, Touch
from rigidfx.effects.base import Effect, Table, Windowed, bends_of
from rigidfx.effects.body_force import BodyForce
from rigidfx.effects.contact import Contact
from rigidfx.effects.contacts.obstacles import Cylinder, Obstacle, Plane, Sphere
from rigidfx.effects.dead_load import DeadLoad
from rigidfx.effects.fixed import Fixed
from rigidfx.effects.gravity import Gravity
from rigidfx.effects.initial_displacement import InitialDisplacement
from rigidfx.effects.initial_velocity import InitialVelocity
from rigidfx.effects.kelvin_voigt import KelvinVoigt
from rigidfx.effects.mass_damping import MassDamping
from rigidfx.effects.nodal_force import NodalForce
from rigidfx.effects.numerical_damping import NumericalDamping
from rigidfx.effects.point_mass import PointMass
from rigidfx.effects.preload import Preload
from rigidfx.effects.prescribed_motion import PrescribedMotion
from rigidfx.effects.prescribed_rotation import PrescribedRotation
from rigidfx.effects.pressure import Pressure
from rigidfx.effects.resultant import Resultant
from rigidfx.effects.rigid import Rigid
from rigidfx.effects.spring import Spring
from rigidfx.effects.stiffness_damping import StiffnessDamping
from rigidfx.effects.support import Support
from rigidfx.effects.symmetry import Symmetry
from rigidfx.effects.traction import Traction

__all__ = [
    "Action",
    "BodyForce",
    "Contact",
    "Cylinder",
    "DeadLoad",
    "Effect",
    "Fixed",
    "FormTerm",
    "Gravity",
    "InitialDisplacement",
    "InitialVelocity",
    "KelvinVoigt",
    "MassDamping",
    "NodalForce",
    "NumericalDamping",
    "Obstacle",
    "Plane",
    "PointMass",
    "Preload",
    "PrescribedMotion",
    "PrescribedRotation",
    "Pressure",
    "Resultant",
    "Rigid",
    "Sphere",
    "Spring",
    "StiffnessDamping",
    "Structure",
    "Support",
    "Symmetry",
    "Table",
    "Touch",
    "Traction",
    "Windowed",
    "bends_of",
]
