"""Whole trials on ``fast``: the same bytes with libraries that take the instructions of another processor."""

import hashlib
import os
import platform
import subprocess
import sys

import pytest

from midnet_bench.campaign.provenance import libm_digest
from midnet_bench.experiments.registry import experiment

POORER = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2_Usable,-AVX2,-FMA,-FMA4,-AVX512F,-AVX",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3,X86_V4",
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENCV_CPU_DISABLE": "AVX512_SKX,AVX2,FMA3,AVX,FP16,SSE4_2,SSE4_1,SSSE3,POPCNT",
}
TRIALS: tuple[tuple[str, dict[str, object]], ...] = (
    ("detection", {"robots": 2, "frames": 5}),
    ("detection", {"robots": 2, "frames": 2, "detector": "clusters", "fusion": "centres"}),
    ("labyrinth", {"robots": 2, "intruders": 1, "time_limit_s": 2.0}),
    ("mapping", {"robots": 1, "time_limit_s": 2.0}),
)


def said() -> list[str]:
    """A digest of what the C library gives, then one of each trial's tables."""
    digests = [libm_digest()]
    for name, values in TRIALS:
        record = experiment(name)
        result = record.trials.run(record.parameters.from_flat({**values, "engine": "fast"}), 1)
        digests.append(hashlib.sha256(repr(sorted(result.tables.items())).encode()).hexdigest())
    return digests


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="these settings are for x86-64")
def test_trials_are_the_same_where_the_libraries_take_other_instructions() -> None:
    code = "from tests.experiments.test_experiments_processors import said; print(*said())"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, **POORER},
        capture_output=True,
        text=True,
        check=True,
    )
    library, *elsewhere = done.stdout.split()
    own_library, *here = said()
    if library == own_library:
        pytest.skip("this C library gives the same without FMA and AVX2, so nothing is shown")
    assert elsewhere == here
