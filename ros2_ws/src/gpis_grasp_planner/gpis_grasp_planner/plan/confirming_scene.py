"""A second look at grasps by PyBullet's scene: the same contacts, and no link deep in the part."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Self

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator


class ConfirmingScene:
    """PyBullet's scene with hand and part, made when it is first asked; a context manager.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    friction : Friction
    settings : SceneSettings
    prepared : PreparedObject
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        friction: Friction,
        settings: SceneSettings,
        prepared: PreparedObject,
    ):
        self._arguments = (hand, part, friction, settings, prepared.field, prepared.tree)
        self._settings = settings
        self._scene: BulletEvaluator | None = None
        self._owned = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._owned.close()

    def agrees(self, grasp: Grasp) -> bool:
        """Whether the scene sees the same grasp; True where `scene.confirm` is off.

        Some 40 ms; the first one also puts the part's mesh into PyBullet, 60 ms and more.
        """
        if not self._settings.confirm:
            return True
        if self._scene is None:
            self._scene = self._owned.enter_context(BulletEvaluator(*self._arguments))
        [look] = self._scene.confirm([grasp])
        return look.contacts_confirmed and look.penetration_m <= self._settings.confirm_tolerance_m
