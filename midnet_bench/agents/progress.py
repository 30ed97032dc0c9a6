"""Does a robot get on? What ``robots.csv`` says of each one beside the way it went."""

import math


class Stay:
    """How long somebody has been within ``radius_m`` of one place."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._place = (math.nan, math.nan)
        self.since_s = 0.0
        """when the stay began"""

    def begin(self, x: float, y: float, time_s: float) -> None:
        """Start a new stay here and now."""
        self._place = (x, y)
        self.since_s = time_s

    def update(self, x: float, y: float, time_s: float) -> None:
        """Take note of where somebody is, metres; leaving the circle begins another stay."""
        if not math.hypot(x - self._place[0], y - self._place[1]) < self._radius_m:
            self.begin(x, y, time_s)


class Progress:
    """Goals of one robot and the time it lost, from its true positions."""

    STUCK_RADIUS_M = 0.25
    STUCK_AFTER_S = 5.0
    LOST_RADIUS_M = 0.5

    def __init__(self) -> None:
        """Nothing done yet."""
        self.goals_reached = 0
        self.goals_given_up = 0
        self.stuck_s = 0.0
        """seconds with a goal but within 0.25 m of one place, where that lasted longer than 5 s: a Burger
        under way is through such a circle in 2.3 s, and one that swings to and fro never leaves it"""
        self._stuck = Stay(self.STUCK_RADIUS_M)
        self._lost = Stay(self.LOST_RADIUS_M)
        self._counted_until_s = 0.0
        self._has_new_goal = True

    def new_goal(self) -> None:
        """Begin to count anew: nobody is to blame for time spent on an earlier goal."""
        self._has_new_goal = True

    def update(self, x: float, y: float, time_s: float, has_goal: bool) -> None:
        """Take note of where the robot is, map frame, metres."""
        if self._has_new_goal or not has_goal:
            self._has_new_goal = False
            self._stuck.begin(x, y, time_s)
            self._lost.begin(x, y, time_s)
        self._stuck.update(x, y, time_s)
        self._lost.update(x, y, time_s)
        if time_s - self._stuck.since_s > self.STUCK_AFTER_S:
            # a long stand counts from its beginning
            self.stuck_s += time_s - max(self._stuck.since_s, self._counted_until_s)
            self._counted_until_s = time_s

    def without_progress_s(self, time_s: float) -> float:
        """How long the robot has been after its goal within half a metre of one place, seconds."""
        return time_s - self._lost.since_s
