"""``make bench``: every benchmark in turn."""

from benchmarks import gmapping, growth, midnet, navigation, physics, scale, store, trial

BENCHMARKS = {
    "trial": trial.main,
    "physics": physics.main,
    "midnet": midnet.main,
    "growth": lambda: growth.main(
        ["--robots", "2", "20", "--areas", "1", "4", "--seconds", "5", "--repeats", "2"]
    ),
    "gmapping": gmapping.main,
    "navigation": navigation.main,
    "scale": scale.main,
    "store": lambda: store.main(1000),
}

if __name__ == "__main__":
    for name, run in BENCHMARKS.items():
        print(f"== {name}", flush=True)
        run()
