"""``Progress``: what the runner tells while a campaign runs."""

from midnet_bench.campaign.worker import Outcome


class Progress:
    """What the runner calls; this one keeps silent."""

    def begin(self, total: int, done: int) -> None:
        """``total`` trials in the campaign, ``done`` of them by earlier runs."""

    def advance(self, outcome: Outcome) -> None:
        """One more trial is stored."""

    def note(self, text: str) -> None:
        """Something that the user should know, in one line."""

    def end(self) -> None:
        """Nothing more will come."""
