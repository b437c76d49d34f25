"""The machines whose turns the paper publishes: the tire machine of Figures 9 to 11 with its magnetic attraction."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.robot import Robot, load_robot

TIRE_PEAK_FRICTION = 0.84  # mu_0 whose normalised force peaks at the 0.8 that Section 3.3 reads off Figure 3
TURN_RPM = (100.0, 70.0)  # the two driving wheels in Figures 9 and 10


@dataclass(frozen=True)
class PublishedTurn:
    """A turn of Figure 9 or 10: attraction of each wheel in robot weights W, published radius and its last digit."""

    case: str
    driving_w: float
    driven_w: float
    radius_mm: float
    last_digit_mm: float = 0.01


PUBLISHED_TURNS = (
    PublishedTurn("9a", 0.0, 0.5, 52.52),
    PublishedTurn("9b", 0.25, 0.25, 46.3, 0.1),
    PublishedTurn("9c, 10b", 0.5, 0.0, 18.27),
    PublishedTurn("10a", 0.0, 0.0, 52.06),
    PublishedTurn("10c", 4.75, 0.0, 15.73),
)


def tire_machine(driving_mN: float = 0.0, driven_mN: float = 0.0, friction: float | None = None) -> Robot:
    """The shipped tire robot with attraction on each driving and driven wheel, and another mu_0 where given."""
    tire = load_robot("tire")
    attraction = {"driving_wheel_mN": driving_mN, "driven_wheel_mN": driven_mN}
    slip = {} if friction is None else {"longitudinal_friction": friction, "lateral_friction": friction}
    return tire.model_copy(
        update={
            "magnetic_attraction": tire.magnetic_attraction.model_copy(update=attraction),
            "slip": tire.slip.model_copy(update=slip),
        }
    )


def machine_of(turn: PublishedTurn) -> Robot:
    """The robot of a published turn."""
    weight_mN = load_robot("tire").weight_uN / 1000
    return tire_machine(turn.driving_w * weight_mN, turn.driven_w * weight_mN)
