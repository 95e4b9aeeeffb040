"""Arrays of NumPy by what they hold, and what divides in place of zero."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int32]  # of cells, nodes and facets of a mesh, as DOLFINx has them
Ints = npt.NDArray[np.int64]

TINY = 1e-300
