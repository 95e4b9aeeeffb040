"""The files of a run: tables, fields for ParaView, bodies."""

from rigidfx.output.bodies_file import read_bodies, write_bodies
from rigidfx.output.field_reader import read_fields
from rigidfx.output.history import read_history
from rigidfx.output.recorder import Recorder

__all__ = ["Recorder", "read_bodies", "read_fields", "read_history", "write_bodies"]
