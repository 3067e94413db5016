"""What every test needs before numpy is imported."""

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # small matrices: threads of BLAS only wait for each other
    os.environ.setdefault(_threads, "1")
