"""Makes ``midnet_bench/cli/parameter_help.json`` from the parameters' declarations: ``make api``.

Commands print what stands there: the declarations need numpy and pydantic, which take half a second.
"""

import json
import re
from pathlib import Path

import typer.main

import midnet_bench
from midnet_bench.campaign.definition import load_campaign
from midnet_bench.cli.app import app
from midnet_bench.cli.options import EXPERIMENT_OF, HELP, KEY_OF, NUMBERS, PARAMETER
from midnet_bench.experiments.registry import parameters_model
from midnet_bench.settings import leaves
from midnet_bench.workflows.campaigns import packaged_campaigns


def page() -> str:
    """Command -> option -> what its help says: the first sentence of its parameter, range and default.

    An option that the command's experiment does not have is left out.
    """
    texts = {
        command: {
            option.name: text
            for option in made.params
            if option.name and getattr(option, "help", None) == PARAMETER
            if (text := help_of(option.name, command)) is not None
        }
        for command, made in typer.main.get_command(app).commands.items()
    }
    return json.dumps({command: options for command, options in texts.items() if options}, indent=1) + "\n"


def help_of(name: str, command: str) -> str | None:
    """What the help of ``command`` says of the option ``name``; None: its experiment does not have it."""
    key, experiment = KEY_OF.get(name, name), EXPERIMENT_OF.get(command)
    experiments = [experiment] if experiment else EXPERIMENT_OF.values()
    leaf = next((known[key] for one in experiments if key in (known := leaves(parameters_model(one)))), None)
    if leaf is None:
        return None
    default: object = leaf.default if experiment else None
    if experiment == command:
        campaign = load_campaign(packaged_campaigns()[command])
        default = campaign.grid.get(key, campaign.parameters.get(key, default))
    texts = [leaf.range] if name in NUMBERS else []
    if default is not None:
        texts.append("default " + ",".join(map(str, default if isinstance(default, list) else [default])))
    sentence = re.split(r"[.;] |\.$", leaf.help)[0]
    return sentence + f" ({'; '.join(texts)})" * bool(texts) + "."


if __name__ == "__main__":
    Path(midnet_bench.__file__).with_name("cli").joinpath(HELP.name).write_text(page(), encoding="utf-8")
