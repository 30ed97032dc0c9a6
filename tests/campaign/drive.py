"""A campaign of coins as a process of its own: ``drive.py DIRECTORY JSON``; exits as the command would."""

import json
import sys
from pathlib import Path

from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.campaign.runner import Progress, run_campaign
from midnet_bench.campaign.trial import Outcome
from midnet_bench.errors import MidnetBenchError
from tests.campaign import coin_experiments


class Telling(Progress):
    """Says on stdout what happens, for a test that waits for it."""

    def begin(self, total: int, done: int) -> None:
        print("begin", total, done, flush=True)

    def advance(self, outcome: Outcome) -> None:
        print("stored", outcome.trial_id, flush=True)

    def note(self, text: str) -> None:
        print("note", text, flush=True)


def main() -> int:
    options = json.loads(sys.argv[2])
    campaign = Campaign(experiment="coins", **options.pop("campaign"))
    try:
        resolved = resolve(campaign, coin_experiments)
        outcome = run_campaign(resolved, Path(sys.argv[1]), progress=Telling(), **options)
    except MidnetBenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    print("done", outcome.finished, outcome.failed, outcome.ran)
    return 0


if __name__ == "__main__":
    sys.exit(main())
