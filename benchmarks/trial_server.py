"""Runs trials for ``benchmarks.compare``, in a process of its own, on the package that PYTHONPATH names.

Reads a line of JSON for each trial from standard input and answers with one. It uses nothing but the package,
so that it can run an older checkout.
"""

import gc
import json
import os
import resource
import sys


def cpu_s() -> float:
    """CPU seconds, user and system, of all threads of this process and of the children that it waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def main() -> None:
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # PyBullet prints when it is loaded
    import midnet_bench
    from midnet_bench.campaign.trial import TrialSpec
    from midnet_bench.experiments import registry

    answers.write(json.dumps({"package": midnet_bench.__file__}) + "\n")
    for line in sys.stdin:
        asked = json.loads(line)
        model = registry.parameters_model(asked["experiment"])
        parameters = model.parse(asked["parameters"], "--set").flat_values()
        spec = TrialSpec(asked["experiment"], parameters, asked["seed"])
        gc.collect()
        begin_s = cpu_s()
        (result,) = registry.run_trials([spec])
        if isinstance(result, Exception):
            raise result
        answer = {
            "cpu_s": cpu_s() - begin_s,
            "simulated_s": result.simulated_s,
            "cpu_before_s": begin_s,
            "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        }
        answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
