"""``make bench``: every benchmark in turn."""

from benchmarks import gmapping, growth, midnet, navigation, physics, scale, store, trial

BENCHMARKS = {
    "trial": trial.main,
    "physics": physics.main,
    "midnet": midnet.main,
    "growth": lambda: growth.table("bullet", [2, 20], [1.0, 4.0], 5.0, 2),
    "gmapping": gmapping.main,
    "navigation": navigation.main,
    "scale": scale.main,
    "store": lambda: store.main(1000),
}

if __name__ == "__main__":
    for name, run in BENCHMARKS.items():
        print(f"== {name}", flush=True)
        run()
