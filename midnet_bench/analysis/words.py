"""What people read instead of a column's name."""

_NAMES = {
    "f1": "F1",
    "f1_one_to_one": "F1 one-to-one",
    "tp": "true positives",
    "fp": "false positives",
    "fn": "misses",
}
_UNITS = {"_m": "m", "_s": "s", "_percent": "%"}


def in_words(name: str) -> str:
    """A measure with its unit, such as ``GOSPA per frame, m`` for ``gospa_per_frame_m``."""
    if name in _NAMES:
        return _NAMES[name]
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            return f"{in_words(name.removesuffix(ending))}, {unit}"
    return name.replace("gospa", "GOSPA").replace("_", " ")


def team_in_words(name: str) -> str:
    """``5 robots`` for ``5-robot``; what follows a comma stays."""
    team, comma, others = name.partition(",")
    if not team.endswith("-robot"):
        return name
    size = team.removesuffix("-robot")
    return f"{size} robot{'' if size == '1' else 's'}{comma}{others}"
