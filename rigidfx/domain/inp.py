"""Read input files of Abaqus and CalculiX: their sets and surfaces become names of a domain."""

from pathlib import Path

from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.files import Decoder
from rigidfx.base.inputs import path_of, positive, shown, truth
from rigidfx.domain.arrays import FileMesh, read_domain
from rigidfx.domain.domain import Domain
from rigidfx.domain.gmsh_model import find_file
from rigidfx.domain.inp_mesh import mesh_of
from rigidfx.domain.inp_model import model_of


def read_inp(
    path: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    scale: float = 1.0,
    corners: bool = False,
    encoding: str | None = None,
) -> Domain:
    """Read the mesh of an input file of Abaqus or CalculiX. Collective.

    Sets of elements become sets of cells, surfaces become sets of facets. A set of nodes becomes
    the facets that it covers, if it consists of the nodes of boundary facets; the edges, if it
    consists of ends and middles of edges; and else a set of vertices. Where a set of nodes and one
    of elements have the same name, as programs write both for a face, that of elements is "NAME
    (elements)"; beside a surface of other facets, a set of nodes is "NAME (nodes)". Names that
    begin with "_" are internal ones and left out. Without any set of elements all cells are named
    "body". Materials, steps and loads are not read.

    Read are *NODE, *ELEMENT, *NSET, *ELSET with GENERATE, *SURFACE, *INCLUDE (of data, too),
    and *PART, *INSTANCE with translation and rotation, *ASSEMBLY. Instances that have no common
    nodes stay apart; a name that several instances have goes by "INSTANCE.NAME". Numbers of a set
    that are not there are left out, with a warning; those of GENERATE in silence.

    Example:
        >>> domain = read_inp("bracket.inp", scale=1e-3)          # doctest: +SKIP

    Args:
        path: The file; it is read on rank 0 only.
        comm: Communicator of the mesh.
        scale: Metres per unit of length of the file.
        corners: Whether cells of second order are read by their corners, with straight edges: for
            bricks of 20 nodes, and for meshes with cells of both orders.
        encoding: Encoding of the file, by Python's name, such as "gb18030". If None, a file that is
            not in UTF-8 is read as cp1252, and a warning shows names with letters beyond ASCII.

    Raises:
        SceneError: If the file is missing or cannot be understood, a set or an element names
            something that is not there, cells are of several or unknown kinds, or inverted.
    """
    path = path_of("read_inp", "path", path)
    factor = positive("read_inp", "scale", scale)
    truth("read_inp", "corners", corners)
    if not (encoding is None or isinstance(encoding, str)):
        raise SceneError(f"read_inp: encoding must be a text or None, got {shown(encoding)}.")
    owner = f"read_inp: '{path}'"

    def read() -> FileMesh:
        find_file(path, "input")
        decoder = Decoder(encoding)
        mesh = mesh_of(model_of(path, decoder), path, bool(corners), factor)
        odd = [name for table in mesh.sets.values() for name in table if not name.isascii()]
        if odd and decoder.guessed:
            mesh.notes.append(
                "it is not in UTF-8, and names are read as those of Western Europe, such as "
                f"{shown(odd[0])}{_in_chinese(odd[0])}. Others need the encoding: read_inp(…, "
                "encoding='gb18030')."
            )
        mesh.notes = [f"{owner}: {note}" for note in mesh.notes]
        return mesh

    return read_domain(comm, owner, owner, read)


def _in_chinese(name: str) -> str:
    """The same bytes in GB18030, where they are letters: which of both is meant, a reader sees."""
    for encoding in ("cp1252", "latin-1"):  # see `decoded`
        try:
            other = name.encode(encoding).decode("gb18030")
        except UnicodeError:
            continue
        letters = all(each.isascii() or each.isalpha() for each in other)
        return f" (in gb18030: {shown(other)})" if letters else ""
    return ""
