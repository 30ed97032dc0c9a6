"""A campaign of coins run as a process of its own: ``drive.py DIRECTORY JSON``, exits as the command would."""

import json
import sys
from pathlib import Path

import coin_experiments

from midnet_bench.campaign.progress import progress_on
from midnet_bench.campaign.runner import run_campaign
from midnet_bench.campaign.spec import Campaign
from midnet_bench.errors import MidnetBenchError


def main() -> int:
    options = json.loads(sys.argv[2])
    campaign = Campaign(experiment="coins", **options.pop("campaign"))
    try:
        run_campaign(
            campaign, Path(sys.argv[1]), experiments=coin_experiments, progress=progress_on(), **options
        )
    except MidnetBenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
