"""OpenMP and BLAS read the number of threads when they are loaded: each run is a new process."""

import os
import subprocess
import sys

TRAIN = """
import hashlib
import numpy as np
from vnav import vocabulary
from vnav.config import VocabularyConfig
descriptors = np.random.default_rng(0).integers(0, 80, (2000, 128)).astype(np.uint8)
tree = vocabulary.train(descriptors, VocabularyConfig(), 0)
print(hashlib.sha256(tree.centres.tobytes() + tree.level.tobytes()).hexdigest())
"""


def test_the_vocabulary_does_not_depend_on_the_number_of_threads() -> None:
    found = set()
    for threads in ("1", "8"):
        done = subprocess.run(
            [sys.executable, "-P", "-c", TRAIN],
            env=os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads},
            text=True,
            capture_output=True,
            check=True,
        )
        found.add(done.stdout)
    assert len(found) == 1
