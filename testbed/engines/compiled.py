"""How the functions of the kernels that other kernels call are compiled: without the wrappers Python would call them through,
which take almost half of the time, and without Python's exceptions on division by zero (infinity and NaN instead, which end a
run as diverged).

`inner`: functions that own no memory. Arrays are handed to them by the entry functions, which keep them alive, so they do
without numba's reference counts, whose atomic instructions took three quarters of a run's time.

`holding`: functions that make arrays, or hand out parts of them. They become part of their caller before LLVM optimises it:
what they call is then a fifth to a quarter faster than where they stay apart.
"""

from numba import njit

_WITHIN = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
inner = njit(_nrt=False, **_WITHIN)  # type: ignore[call-overload]
holding = njit(forceinline=True, **_WITHIN)  # type: ignore[call-overload]
