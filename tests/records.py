"""The records of users, and of each some values that it is made from."""

import numpy as np

import rigidfx as rf
from rigidfx.domain.domain import EntitySet
from rigidfx.plot import Curve


def nothing(*_):
    return (0.0, 0.0, 0.0)


def window():
    return {"since": np.array(0.5), "until": np.array(2.0)}


# Of each record what it is made from, everything in a container that can be changed.
RECORDS = {
    rf.Table: lambda: {"times": np.array([0.0, 1.0]), "values": [0.0, np.array(2.0)]},
    rf.BodyForce: lambda: {"value": np.array([1.0, 2.0, 3.0]), **window()},
    rf.Gravity: lambda: {"value": [0.0, 0.0, -9.0], **window()},
    rf.NodalForce: lambda: {"where": "x0", "value": np.array([1.0, 2.0, 3.0]), **window()},
    rf.Traction: lambda: {"where": "x0", "value": np.array([1.0, 2.0, 3.0]), **window()},
    rf.Pressure: lambda: {"where": "x0", "value": np.array(3.0), **window()},
    rf.Resultant: lambda: {"force": np.array([1.0, 0, 0]), "torque": [0, 1, 0], **window()},
    rf.Fixed: lambda: {"where": "x0", **window()},
    rf.PrescribedMotion: lambda: {"where": "x0", "displacement": nothing, **window()},
    rf.InitialVelocity: lambda: {
        "linear": np.array([1.0, 0, 0]),
        "angular": [0.0, 1.0, 0.0],
        "centre": np.array([0.0, 0, 1]),
    },
    rf.PrescribedRotation: lambda: {
        "where": "x0",
        "axis": np.array([0.0, 0, 1]),
        "through": [0.0, 1.0, 0.0],
        "angle": nothing,
        **window(),
    },
    rf.Symmetry: lambda: {"where": "x0", **window()},
    rf.StiffnessDamping: lambda: {"ratio": np.array(0.1), "frequency": np.array(2.0), **window()},
    rf.InitialDisplacement: lambda: {"function": nothing},
    rf.KelvinVoigt: lambda: {"eta": np.array(2.0), **window()},
    rf.MassDamping: lambda: {"alpha": np.array(2.0), **window()},
    rf.NumericalDamping: lambda: {"xi": np.array(0.1), **window()},
    rf.PointMass: lambda: {"where": "x0", "mass": np.array(2.0)},
    rf.Preload: lambda: {"loads": [rf.Gravity()], "increments": np.array(2)},
    rf.ResolvedForces: lambda: {},
    rf.Reduced: lambda: {"where": "half", "shapes": np.array(3)},
    rf.Rigid: lambda: {"mass": np.array(2.0), "inertia": np.eye(3)},
    rf.Spring: lambda: {
        "where": "x0",
        "stiffness": np.eye(3),
        "damping": [[1.0, 0, 0], [0, 1.0, 0], np.array([0, 0, 1.0])],
    },
    rf.SpringDamper: lambda: {
        "a": "ground",
        "b": "x0",
        "stiffness": np.array(2.0),
        "damping": np.array(2.0),
        "length": np.array(0.1),
        "at_a": np.array([3.0, 0, 0]),
    },
    rf.Contact: lambda: {
        "where": "x0",
        "against": rf.Plane((0, 0, 0), (0, 0, 1)),
        "stiffness": np.array(2.0),
        "friction": np.array(0.1),
        "creep": np.array(0.1),
        **window(),
    },
    rf.MeanFace: lambda: {"where": "x0"},
    rf.RigidFace: lambda: {"where": "x0"},
    rf.Stop: lambda: {"joint": "hinge", "high": np.array(1.0), "stiffness": np.array(3.0)},
    rf.Spherical: lambda: {"a": "ground", "b": "x0", "at": np.array([1.0, 0, 0])},
    **dict.fromkeys(
        (rf.Revolute, rf.Cylindrical, rf.Prismatic),
        lambda: {
            "a": rf.MeanFace("x0"),
            "b": rf.MeanFace("x1"),
            "at": [1.0, 0.0, 0.0],
            "axis": np.array([0.0, 0, 1]),
        },
    ),
    rf.Universal: lambda: {
        "a": "ground",
        "b": "x0",
        "at": np.array([1.0, 0, 0]),
        "axis_a": [1.0, 0.0, 0.0],
        "axis_b": np.array([0.0, 1, 0]),
    },
    rf.Tied: lambda: {"a": "ground", "b": "x0", "at": np.array([1.0, 0, 0])},
    rf.Motor: lambda: {"joint": "hinge", "torque": np.array(2.0), **window()},
    rf.JointSpring: lambda: {
        "joint": "hinge",
        "stiffness": np.array(2.0),
        "damping": np.array(2.0),
        "rest": np.array(0.1),
    },
    rf.Plane: lambda: {"point": np.array([1.0, 0, 0]), "normal": [0.0, 0.0, 1.0]},
    rf.Sphere: lambda: {"centre": np.array([1.0, 0, 0]), "radius": np.array(2.0)},
    rf.Cylinder: lambda: {"centre": [1.0, 0, 0], "radius": 2.0, "axis": np.array([1.0, 0, 0])},
    rf.Release: lambda: {"at": np.array([1.0, 2.0])},
    rf.StrainRate: lambda: {
        "tol": np.array(0.1),
        "window": np.array(0.2),
        "tolerances": {"x0": np.array(0.3)},
        "never": ["x0"],
        "release": [rf.Release(at=1.0)],
        "wake": "all",
        "load_change": np.array(0.2),
        "patience": np.array(2.0),
        **window(),
    },
    rf.AssumedStrains: lambda: {"thickness": "x0"},
    rf.Relative: lambda: {"part": np.array(0.1)},
    rf.StepControl: lambda: {
        "tol": np.array(0.1),
        "at": ["tip", "top"],
        "largest": np.array(0.2),
        "smallest": np.array(0.1),
        "of": np.array(3.0),
    },
    rf.Accuracy: lambda: {
        "budget": np.array(0.1),
        "at": ["tip", "top"],
        "of": np.array(3.0),
        "smallest": np.array(0.1),
        "min_cells": 3,
        "never": ["x0"],
    },
    rf.StVenantKirchhoff: lambda: {"rho": np.array(2.0), "E": np.array(5.0), "nu": np.array(0.3)},
    rf.NeoHooke: lambda: {"rho": np.array(2.0), "E": np.array(5.0), "nu": np.array(0.3)},
    rf.MooneyRivlin: lambda: {name: np.array(2.0) for name in ("rho", "c10", "c01", "kappa")},
    rf.Hyperelastic: lambda: {
        "rho": np.array(2.0),
        "W": nothing,
        "values": {"mu": np.array(1.0), "k": 2.0},
    },
    Curve: lambda: {"label": "a", "x": np.array([0.0, 1.0]), "y": [0.0, 1.0]},
    EntitySet: lambda: {"name": "a", "dim": 3, "entities": np.arange(3, dtype=np.int32)},
}
