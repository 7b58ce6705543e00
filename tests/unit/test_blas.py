"""A bake by the library has one thread of matrices, and gives back those it took."""

import os
import subprocess
import sys

import pytest

from tests.conftest import MILK, ROOT

CODE = """\
import sys
import bakery
from bakery.run.progress import Progress
from bakery.system import blas

class Told(Progress):
    def done(self, name, text):
        print("within", *blas.threads())

for _, put in blas._libraries():
    put(2)
bakery.bake(sys.argv[1], "a.h5", jobs=1, progress=Told())
print("between", *blas.threads())
try:
    with blas.one_thread():
        with blas.one_thread():
            pass
        print("within", *blas.threads())  # the outer one goes on
        raise KeyError
except KeyError:
    print("after", *blas.threads())
"""


@pytest.mark.slow
@pytest.mark.parametrize("asked", [{}, {"OMP_NUM_THREADS": "2"}])
def test_one_thread_of_matrices_while_it_bakes(asked, tmp_path):
    (tmp_path / "milk.yaml").write_text(MILK.format(name="milk", g=0.7))
    environment = {name: value for name, value in os.environ.items() if name not in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")}
    environment |= {"PYTHONPATH": str(ROOT), "BAKERY_CACHE": str(tmp_path / "cache"), **asked}
    done = subprocess.run([sys.executable, "-c", CODE, str(tmp_path / "milk.yaml")], env=environment, cwd=tmp_path, text=True,
                          capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    counts = "2 2" if asked else "1 1"
    assert done.stdout.splitlines() == [f"within {counts}", "between 2 2", f"within {counts}", "after 2 2"]
