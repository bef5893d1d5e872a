"""One design, checked against (6), (7) and (8): a curve and a formation for given bodies and sensors."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lissajous_env.parameters.parts import Curve
from lissajous_env.theory import geometry


@dataclass(frozen=True)
class Candidate:
    """One design: a curve with a + b = N, its formation, and what the two ask of the robots' bodies and sensors."""

    curve: Curve
    """The curve (3), and with it the rectangle."""
    num_robots: int
    """N = a + b."""
    phase_rate: float
    """omega, along the curve [rad/s]."""
    robot_radius: float
    """r_i of the robots asked about [m]."""
    sensor_radius: float
    """r_s of the sensors asked about [m]."""
    wheelbase: float | None
    """l of the cars asked about [m]; None for robots that turn on the spot."""
    steering_max: float
    """Largest steering angle of these cars [rad]."""
    p: int
    """p of the least clustered stable equilibrium (2)."""
    alpha: int
    """alpha of Lemma 2, which makes ring neighbours neighbours on ellipse (5)."""
    clusters: int
    """kappa, robots that share a place (Lemma 1): 1, but for N = 4 and 6."""
    robot_radius_bound: float
    """r_max of (6) [m], 0 where robots share a place; bodies must be below it."""
    robot_radius_measured: float
    """Half of the smallest distance ever seen in the formation [m]."""
    coverage_radius: float
    """Sensing radius of (7) [m]; the sensor must be above it."""
    detection_radius: float
    """Sensing radius of (8) [m]; the sensor must be at least this."""
    detection_time_bound: float
    """T_max [s]."""
    top_speed: float
    """Speed of the fastest stretch of the curve, omega max ||r'|| [m/s]."""
    tight_share: float | None
    """Share of the arc that turns tighter than the cars can; None for robots that turn on the spot."""

    @property
    def avoids_collisions(self) -> bool:
        """Whether (6) holds."""
        return self.robot_radius < self.robot_radius_bound

    @property
    def covers(self) -> bool:
        """Whether (7) holds."""
        return self.sensor_radius > self.coverage_radius

    @property
    def detects(self) -> bool:
        """Whether (8) holds."""
        return self.sensor_radius >= self.detection_radius

    @property
    def feasible(self) -> bool:
        """Whether (6), (7) and (8) all hold."""
        return self.avoids_collisions and self.covers and self.detects

    @property
    def margin(self) -> float:
        """By how much, relatively, the tightest of (6), (7) and (8) is met; below 0 where it is not."""
        required = max(self.coverage_radius, self.detection_radius)
        return min(self.robot_radius_bound / self.robot_radius, self.sensor_radius / required) - 1

    @cached_property
    def coverage_radius_measured(self) -> float:
        """Sensing radius with which a lap really covers the rectangle [m]."""
        return geometry.measured_coverage_radius(self.curve)

    @property
    def works_measured(self) -> bool:
        """Whether it works by what is measured in the undisturbed formation, where (6) or (7) may ask for too much."""
        apart = self.robot_radius < self.robot_radius_measured
        return apart and self.detects and self.sensor_radius > self.coverage_radius_measured

    @property
    def reason(self) -> str:
        """Why it does not work, in words; empty where it does."""
        reasons = []
        if self.clusters > 1:
            reasons.append(f"{self.clusters} robots share each place: no p of N = {self.num_robots} parts them")
        elif not self.avoids_collisions:
            touch = "touch" if self.robot_radius >= self.robot_radius_measured else "may touch"
            reasons.append(f"robots of {self.robot_radius:.4g} m {touch}: (6) allows {self.robot_radius_bound:.4g} m")
        needed = f", sensors reach {self.sensor_radius:.4g} m"
        if not self.covers:
            reasons.append(f"a lap may leave gaps: (7) asks for {self.coverage_radius:.4g} m{needed}")
        if not self.detects:
            reasons.append(f"sensing discs part: (8) asks for {self.detection_radius:.4g} m{needed}")
        return "; ".join(reasons)

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides that turn the scenario `experiment` into this design, without its faults."""
        car = {"robot.wheelbase": self.wheelbase, "robot.steering_max": self.steering_max}
        return {
            "curve.half_width": self.curve.half_width,
            "curve.half_height": self.curve.half_height,
            "curve.a": self.curve.a,
            "curve.b": self.curve.b,
            "formation.phase_rate": self.phase_rate,
            "formation.p": self.p,
            "formation.alpha": self.alpha,
            "formation.ring": None,
            "robot.kind": "curve" if self.wheelbase is None else "car",
            **({} if self.wheelbase is None else car),
            "robot.radius": self.robot_radius,
            "sensing.radius": self.sensor_radius,
            "faults.schedule": (),
        }
