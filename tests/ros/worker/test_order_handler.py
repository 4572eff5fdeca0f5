"""A planning process that was started anew answers from the grasp store."""

from __future__ import annotations

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.ros.worker.messages import PlanOrder
from gpis_grasp_planner.ros.worker.order_handler import OrderHandler


def silent(_):
    return None


def test_a_plan_outlives_the_process_and_a_changed_setting_is_planned_anew(tmp_path):
    settings = PlannerSettings.from_mapping({"store": {"path": str(tmp_path / "grasps.sqlite")}})
    values = {"catalogue": CatalogueSettings().as_dict(), **settings.as_dict()}
    request = PlanRequest(time_budget_s=60.0, max_evaluations=128, n_grasps=3)
    order = PlanOrder("mug", (str(default_catalogue_directory()),), request, values)
    first = OrderHandler().make_plan(order, silent)
    assert first.code == ErrorCode.SUCCESS
    assert not first.from_store
    again = OrderHandler().make_plan(order, silent)
    assert again.from_store
    assert again.notes[-1].startswith("From the grasp store: planned 20")
    assert [g.epsilon for g in again.grasps] == [g.epsilon for g in first.grasps]
    assert again.record  # to be placed elsewhere, as any plan
    values["hpp"] = {**values["hpp"], "volume_weight": 0.25}
    assert not OrderHandler().make_plan(order, silent).from_store
