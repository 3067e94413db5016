"""How the inner functions of the kernels are compiled.

They own no memory: arrays are handed to them by the entry functions, which keep them alive. So they are compiled without
numba's reference counts, whose atomic instructions took three quarters of a run's time, and without Python's exceptions
on division by zero (infinity and NaN instead, which end a run as diverged).
"""

from numba import njit

inner = njit(_nrt=False, error_model="numpy")  # type: ignore[call-overload]
inlined = njit(inline="always", _nrt=False, error_model="numpy")  # type: ignore[call-overload]
