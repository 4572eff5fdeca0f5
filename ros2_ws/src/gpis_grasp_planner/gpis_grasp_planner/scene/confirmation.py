"""A second opinion on a finished grasp: the verdict of another scene than the search's."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Confirmation:
    """What PyBullet says of a finished grasp.

    Attributes
    ----------
    penetration_m : float
        Depth of the deepest link; 0 where none penetrates.
    deepest_link : str or None
    farthest_contact_m : float
        Largest distance of a claimed contact's link from the object.
    contacts_confirmed : bool
        Whether every claimed contact's link is within the contact threshold.
    """

    penetration_m: float
    deepest_link: str | None
    farthest_contact_m: float
    contacts_confirmed: bool

    @property
    def confirmed(self) -> bool:
        """No penetration, and every contact is there."""
        return self.penetration_m <= 0.0 and self.contacts_confirmed
