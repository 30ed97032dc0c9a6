"""``make bench``: every benchmark in turn."""

from benchmarks import gmapping, midnet, navigation, physics, store, trial

BENCHMARKS = {
    "trial": trial.main,
    "physics": physics.main,
    "midnet": midnet.main,
    "gmapping": gmapping.main,
    "navigation": navigation.main,
    "store": lambda: store.main(1000),
}

if __name__ == "__main__":
    for name, run in BENCHMARKS.items():
        print(f"== {name}", flush=True)
        run()
