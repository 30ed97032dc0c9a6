"""Makes ``midnet_bench/cli/parameter_help.json`` from the parameters' declarations: ``make api``.

Commands print what stands there: the declarations need numpy and pydantic, which take half a second.
"""

import inspect
import json
import re
from pathlib import Path

import midnet_bench
from midnet_bench.campaign.definition import load_campaign
from midnet_bench.cli.app import app
from midnet_bench.cli.options import HELP, NUMBERS, PARAMETERS
from midnet_bench.experiments.registry import parameters_model
from midnet_bench.settings import leaves
from midnet_bench.workflows.campaigns import packaged_campaigns

EXPERIMENT_OF = {"detection": "detection", "labyrinth": "labyrinth", "map": "mapping"}
"""command -> the experiment that its parameters are of"""


def page() -> str:
    """Command -> option without own help -> help of its parameter, if the command's experiment has it."""
    texts: dict[str, dict[str, str]] = {}
    for command in app.registered_commands:
        for name, parameter in inspect.signature(command.callback).parameters.items():  # type: ignore[arg-type]
            kind, (option, *_) = parameter.annotation.__origin__, parameter.annotation.__metadata__
            if option.help is None and (text := help_of(name, str(command.name))):
                repeats = " May be repeated." if kind == list[str] | None else ""
                texts.setdefault(str(command.name), {})[name] = text + repeats
    return json.dumps(texts, indent=1) + "\n"


def help_of(name: str, command: str) -> str | None:
    """First sentence, range and default of an option's parameter; None: the experiment does not have it."""
    key, experiment = PARAMETERS[name], EXPERIMENT_OF.get(command)
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
