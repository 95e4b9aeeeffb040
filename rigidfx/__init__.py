"""rigidfx: structural dynamics in which only the parts that deform are computed as flexible.

Geometrically nonlinear elastodynamics in 3D on top of FEniCSx, by the Energy-Momentum Method. A
scene names a domain, materials and effects; `simulate` yields a report per step; a `Recorder`
writes ParaView files and a CSV.
"""

import rigidfx.base.dolfinx_first  # noqa: F401 - before DOLFINx, petsc4py and mpi4py
from rigidfx.base.errors import (
    CompilerError,
    InversionError,
    OutputError,
    RigidfxError,
    RigidfxWarning,
    SceneError,
    StepError,
)
from rigidfx.base.shared_cells import share_cells
from rigidfx.base.uncaught import end_together
from rigidfx.checkpoint.keeper import Checkpoint
from rigidfx.decide.accuracy import Accuracy
from rigidfx.decide.rules import Relative
from rigidfx.decide.settings import Release, StrainRate
from rigidfx.domain.arrays import box, from_arrays
from rigidfx.domain.cad import list_cad, read_cad
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import from_gmsh, read_msh
from rigidfx.domain.gmsh_script import read_geo
from rigidfx.domain.inp import read_inp
from rigidfx.domain.redistribute import redistribute
from rigidfx.effects import (
    BodyForce,
    Contact,
    Cylinder,
    Cylindrical,
    Fixed,
    Gravity,
    InitialDisplacement,
    InitialVelocity,
    JointSpring,
    KelvinVoigt,
    MassDamping,
    MeanFace,
    Motor,
    NodalForce,
    NumericalDamping,
    Plane,
    PointMass,
    Preload,
    PrescribedMotion,
    PrescribedRotation,
    Pressure,
    Prismatic,
    Reduced,
    ResolvedForces,
    Resultant,
    Revolute,
    Rigid,
    RigidFace,
    Sphere,
    Spherical,
    Spring,
    SpringDamper,
    StiffnessDamping,
    Stop,
    Symmetry,
    Table,
    Tied,
    Traction,
    Universal,
    rayleigh,
)
from rigidfx.mechanics.enhanced import AssumedStrains
from rigidfx.mechanics.materials import (
    Hyperelastic,
    Material,
    MooneyRivlin,
    NeoHooke,
    StVenantKirchhoff,
)
from rigidfx.mechanics.schemes import EnergyMomentum, Midpoint, Trapezoidal
from rigidfx.output.bodies_file import read_bodies, read_joints, write_bodies
from rigidfx.output.field_reader import read_fields
from rigidfx.output.history import read_history
from rigidfx.output.recorder import Recorder
from rigidfx.report.report import Report, recovered_stress
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import StepControl
from rigidfx.simulation import resume, simulate
from rigidfx.statics import compliance, static
from rigidfx.vibration.modes import Modes, modes, periods

__version__ = "0.2.0"

share_cells()
end_together()

__all__ = [
    "Accuracy",
    "AssumedStrains",
    "BodyForce",
    "Checkpoint",
    "CompilerError",
    "Contact",
    "Cylinder",
    "Cylindrical",
    "Domain",
    "EnergyMomentum",
    "Fixed",
    "Gravity",
    "Hyperelastic",
    "InitialDisplacement",
    "InitialVelocity",
    "InversionError",
    "JointSpring",
    "KelvinVoigt",
    "MassDamping",
    "Material",
    "MeanFace",
    "Midpoint",
    "Modes",
    "MooneyRivlin",
    "Motor",
    "NeoHooke",
    "NodalForce",
    "NumericalDamping",
    "OutputError",
    "Plane",
    "PointMass",
    "Preload",
    "PrescribedMotion",
    "PrescribedRotation",
    "Pressure",
    "Prismatic",
    "Recorder",
    "Reduced",
    "Relative",
    "Release",
    "Report",
    "ResolvedForces",
    "Resultant",
    "Revolute",
    "Rigid",
    "RigidFace",
    "RigidfxError",
    "RigidfxWarning",
    "Scene",
    "SceneError",
    "Sphere",
    "Spherical",
    "Spring",
    "SpringDamper",
    "StVenantKirchhoff",
    "StepControl",
    "StepError",
    "StiffnessDamping",
    "Stop",
    "StrainRate",
    "Symmetry",
    "Table",
    "Tied",
    "Traction",
    "Trapezoidal",
    "Universal",
    "box",
    "compliance",
    "from_arrays",
    "from_gmsh",
    "list_cad",
    "modes",
    "periods",
    "rayleigh",
    "read_bodies",
    "read_cad",
    "read_fields",
    "read_geo",
    "read_history",
    "read_inp",
    "read_joints",
    "read_msh",
    "recovered_stress",
    "redistribute",
    "resume",
    "simulate",
    "static",
    "write_bodies",
]


def __dir__() -> list[str]:
    """Exported names, and the version: folders of the package are imported by their names."""
    return [*__all__, "__doc__", "__version__"]
