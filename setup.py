"""Which folders of the repository travel inside the package; ``pyproject.toml`` says all the rest.

Each has one home, and a wheel has a copy: ``midnet_bench.io.files`` finds whichever is there.
"""

from setuptools import find_namespace_packages, setup

SHIPPED = {
    "midnet_bench.campaigns": "campaigns",
    "midnet_bench.reference.detection": "results/reference/detection",
    "midnet_bench.reference.standard": "results/reference/standard",
    "midnet_bench.golden.smoke-detection": "results/reference/smoke/smoke-detection",
    "midnet_bench.golden.smoke-labyrinth": "results/reference/smoke/smoke-labyrinth",
}

setup(
    packages=[*find_namespace_packages(include=["midnet_bench", "midnet_bench.*"]), *SHIPPED],
    package_dir=SHIPPED,
)
