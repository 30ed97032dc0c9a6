"""What ``pyproject.toml`` cannot say beside a search for packages: campaign files travel with the package.

``campaigns/`` is the one home of the campaign files, and a wheel has them as ``midnet_bench/campaigns/``.
"""

from setuptools import find_namespace_packages, setup

setup(
    packages=[*find_namespace_packages(include=["midnet_bench", "midnet_bench.*"]), "midnet_bench.campaigns"],
    package_dir={"midnet_bench.campaigns": "campaigns"},
)
