"""Does a robot get on? What ``robots.csv`` says of each one beside the way it went."""

import math


class Progress:
    """Goals of one robot and the time it lost, from its true positions."""

    STUCK_RADIUS_M = 0.1
    STUCK_AFTER_S = 5.0

    def __init__(self) -> None:
        """Nothing done yet."""
        self.goals_reached = 0
        self.goals_given_up = 0
        self.stuck_s = 0.0
        """seconds with a goal but within 0.1 m of one place, where that lasted longer than 5 s"""
        self.standing_since_s = 0.0
        """when it last left the 0.1 m around one place, or had no goal"""
        self._place = (math.nan, math.nan)
        self._counted_until_s = 0.0

    def update(self, x: float, y: float, time_s: float, has_goal: bool) -> None:
        """Take note of where the robot is, map frame, metres."""
        stays = math.hypot(x - self._place[0], y - self._place[1]) < self.STUCK_RADIUS_M
        if not (stays and has_goal):
            self._place = (x, y)
            self.standing_since_s = time_s
        elif time_s - self.standing_since_s > self.STUCK_AFTER_S:
            # a long stand counts from its beginning
            self.stuck_s += time_s - max(self.standing_since_s, self._counted_until_s)
            self._counted_until_s = time_s
