"""``python -m midnet_bench`` is the ``midnet-bench`` command."""

from midnet_bench.cli import main

if __name__ == "__main__":
    main()
