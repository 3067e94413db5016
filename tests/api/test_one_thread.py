"""The answer hangs neither on the threads of linear algebra nor on who else works at the same time."""

import json
import os
import subprocess
import sys
import threading

from testbed.api.working import THREADS, working

CODE = """
import json, os, numpy
from threadpoolctl import threadpool_info, threadpool_limits
import testbed
from testbed.api.working import working
def threads():
    return sorted({one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"})
import scipy.linalg
threadpool_limits(2)
before = threads()
with working():
    inside = threads(), os.environ["OPENBLAS_NUM_THREADS"]
    with working():
        deeper = threads()
    still = threads()
print(json.dumps([before, inside, deeper, still, threads(), os.environ.get("OPENBLAS_NUM_THREADS")]))
"""


def test_one_thread_inside_and_what_was_there_after():
    environment = {name: value for name, value in os.environ.items() if name not in THREADS}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True, env=environment)
    assert json.loads(done.stdout) == [[2], [[1], "1"], [1], [1], [2], None]


def test_the_answer_is_the_command_line_s_whatever_threads_the_caller_has(tmp_path):
    (tmp_path / "model.yaml").write_text("""structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
cutter: {flutes: 1, diameter: 19.05 mm}
cutting: {immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
effects: {process_damping: {coefficient: 1.0e5 N/m}}
""")
    ours = "import numpy; numpy.ones((500, 500)) @ numpy.ones((500, 500)); import testbed; " \
           "print(testbed.multipliers('model.yaml', '3810 rpm', '2.9 mm').json, end='')"
    theirs = "from testbed.cli import main; " \
             "main(['multipliers', 'model.yaml', '--speed', '3810', '--depth', '2.9', '--json', '-'])"
    bare = {name: value for name, value in os.environ.items() if name not in THREADS}
    bare["PYTHONPATH"] = os.pathsep.join(place for place in sys.path if place)
    one, other = (subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path,
                                 env=bare).stdout for code in (ours, theirs))
    assert one == other and len(one) > 400


def test_the_limit_ends_with_the_last_who_works():
    before = {name: os.environ.get(name) for name in THREADS}
    inside, go = threading.Barrier(2), threading.Event()

    def other():
        with working():
            inside.wait(30)
            go.wait(30)

    thread = threading.Thread(target=other)
    thread.start()
    with working():
        inside.wait(30)
    assert os.environ["OMP_NUM_THREADS"] == "1"
    go.set()
    thread.join()
    assert {name: os.environ.get(name) for name in THREADS} == before
