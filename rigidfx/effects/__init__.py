"""Effects of a scene: loads, supports, damping, attachments, initial motion, rigid parts.

Every effect is a frozen record in SI units, in a file of its own with its forces, and knows at
which instants it changes abruptly; steps end exactly there. An effect that a scene does not name
adds nothing to the compiled forms, and no action to a step: see `action`.
"""

from rigidfx.effects.action import Action, FormTerm, Structure, Touch
from rigidfx.effects.attached.point_mass import PointMass
from rigidfx.effects.attached.spring import Spring
from rigidfx.effects.attached.spring_damper import SpringDamper, SpringDamperReport
from rigidfx.effects.base import Effect, Table, Windowed, bends_of
from rigidfx.effects.contact import Contact
from rigidfx.effects.contacts.obstacles import Cylinder, Obstacle, Plane, Sphere
from rigidfx.effects.damping import (
    KelvinVoigt,
    MassDamping,
    NumericalDamping,
    StiffnessDamping,
    rayleigh,
)
from rigidfx.effects.initial import InitialDisplacement, InitialVelocity, Preload, places_at_start
from rigidfx.effects.joints.elements import JointSpring, Motor, Stop, efforts_of
from rigidfx.effects.joints.joint import (
    Cylindrical,
    Joint,
    Prismatic,
    Revolute,
    Spherical,
    Tied,
    Universal,
)
from rigidfx.effects.joints.linkage import JointReport, JointReports
from rigidfx.effects.joints.sides import MeanFace, RigidFace, rigid_faces
from rigidfx.effects.loads.dead_load import BodyForce, DeadLoad, Gravity, NodalForce, Traction
from rigidfx.effects.loads.pressure import Pressure
from rigidfx.effects.loads.resultant import Resultant
from rigidfx.effects.rigid import Reduced, Rigid
from rigidfx.effects.supports import (
    Fixed,
    PrescribedMotion,
    PrescribedRotation,
    ResolvedForces,
    Support,
    Symmetry,
)
