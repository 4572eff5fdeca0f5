"""The node's own settings, and the groups whose fields become its parameters.

Free of rclpy, so that ``docs/parameters.md`` and the planning process can use it.
"""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import FRICTION_RANGE, Friction
from gpis_grasp_planner.grasp.trials import VERIFICATIONS
from gpis_grasp_planner.plan.request import (
    GRASP_COUNT_RANGE,
    SEED_LIMIT,
    TIME_BUDGET_RANGE_S,
    check_friction,
)
from gpis_grasp_planner.ros.detections import mapping_of
from gpis_grasp_planner.ros.scene_defaults import (
    near_origin,
    obstacles_of,
    point_of_text,
    pose_of_text,
)
from gpis_grasp_planner.ros.text import FRAME_PATTERN, printable
from gpis_grasp_planner.settings import SettingsGroup, setting
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.place import STAND_IN

# Those of search.searches.PLANNERS, whose import would cost the node 100 MB and 3 s; a test
# compares them.
PLANNER_NAMES = (
    "dual",
    "hpp",
    "paper",
    "random",
    "random-adaption",
)


NO_FLANGE = "0 0 0 0 0 0 1"
HAND_FRAMES = ("links", "root", "none")
POSE_TYPES = ("pose_stamped", "pose_with_covariance_stamped", "detection3d_array", "tf")


@dataclass(frozen=True)
class NodeSettings(SettingsGroup):
    """What the node does around the planning: catalogue, poses, limits of a request, queue."""

    mesh_directories: tuple[str, ...] = setting(
        (),
        description="Directories of the mesh catalogue, searched in this order; empty for the "
        "parts that ship with the package.",
    )
    pose_type: str = setting(
        "pose_stamped",
        choices=POSE_TYPES,
        description="Message type of the topic object_pose; or detection3d_array "
        "(vision_msgs, topic detections), or tf: a frame for each part, by object_frames.",
    )
    class_ids: tuple[str, ...] = setting(
        (),
        description="For detection3d_array: pairs 'class_id=mesh_id'; a class without one is "
        "taken for a mesh ID.",
    )
    min_score: float = setting(
        0.5, low=0.0, high=1.0, description="Detections with a lower score are left out."
    )
    instance_point: str = setting(
        "",
        description="Of several detections of a part the one nearest to this point x y z is "
        "taken, in their frame; empty: the one with the best score.",
    )
    object_frames: tuple[str, ...] = setting(
        (), description="For tf: pairs 'frame=mesh_id', where the part's own frame is that frame."
    )
    object_parent_frame: str = setting(
        "",
        description="For tf: the frame in which the poses of these frames are taken, such as the "
        "robot's base; it must be set.",
    )
    max_pose_age_s: float = setting(
        5.0, low=0.01, high=86_400.0, description="An older object pose is refused as stale."
    )
    max_pose_ahead_s: float = setting(
        0.5,
        low=0.0,
        high=60.0,
        description="An object pose stamped further in the future than this is refused.",
    )
    default_time_budget_s: float = setting(
        10.0,
        low=TIME_BUDGET_RANGE_S[0],
        high=TIME_BUDGET_RANGE_S[1],
        description="Planning time where the request gives 0.",
    )
    max_time_budget_s: float = setting(
        120.0,
        low=TIME_BUDGET_RANGE_S[0],
        high=TIME_BUDGET_RANGE_S[1],
        description="Longest planning time a request may ask for.",
    )
    default_n_grasps: int = setting(
        20,
        low=GRASP_COUNT_RANGE[0],
        high=GRASP_COUNT_RANGE[1],
        description="Number of grasps where the request gives 0. A plan holds at least so many, "
        "if it finds them.",
    )
    default_seed: int = setting(
        0, low=0, high=SEED_LIMIT, description="Seed where the request gives -1."
    )
    default_planner: str = setting(
        "dual", choices=PLANNER_NAMES, description="Planner where the request gives none."
    )
    default_verification: str = setting(
        "rank",
        choices=VERIFICATIONS,
        description="Whether grasps are tried in physics where the request says nothing: not at "
        "all, those that hold first, or only those that hold.",
    )
    friction_finger: float = setting(
        0.0,
        low=0.0,
        high=FRICTION_RANGE[1],
        description="Coulomb coefficient between finger links and parts; 0: what the part's YAML "
        "file says, else 0.6. Set together with friction_palm.",
    )
    friction_palm: float = setting(
        0.0,
        low=0.0,
        high=FRICTION_RANGE[1],
        description="Coulomb coefficient between the palm and parts; 0: as for friction_finger.",
    )
    queue_size: int = setting(
        4,
        low=0,
        high=32,
        description="Requests that may wait while another is planned; one more is answered BUSY.",
    )
    planning_grace_s: float = setting(
        10.0,
        low=0.5,
        high=120.0,
        description="Time beyond its budget after which a plan is given up and its process "
        "restarted; it covers reading the mesh and the preparation.",
    )
    mesh_read_limit_s: float = setting(
        60.0,
        low=1.0,
        high=3600.0,
        description="Time after which reading one mesh file is given up.",
    )
    mesh_preparation_limit_s: float = setting(
        120.0,
        low=5.0,
        high=3600.0,
        description="Time after which the planning process is restarted while it reads and "
        "prepares a mesh; that goes on, and is kept, where its request was answered "
        "DEADLINE_EXCEEDED.",
    )
    retries_of_lost_orders: int = setting(
        1,
        low=0,
        high=1,
        description="How often a request whose planning process died is given to the next one.",
    )
    worker_memory_limit_mb: float = setting(
        2000.0,
        low=500.0,
        high=1_000_000.0,
        description="A planning process that has more memory than this for itself is replaced "
        "between two plans.",
    )
    worker_nice: int = setting(
        0,
        low=0,
        high=19,
        description="How far the planning process and its children stand back behind others, the "
        "node among them, where cores are scarce: their nice value, from their next start on.",
    )
    preempt_goals: bool = setting(
        False,
        description="Whether a new goal of the action ends those accepted before it.",
    )
    plan_cache_size: int = setting(
        64, low=0, high=10_000, description="Plans kept in memory; the oldest go first."
    )
    track: bool = setting(
        False,
        description="Whether the last grasp is published anew, from memory and checked against "
        "the surroundings, when another estimate of its part comes.",
    )
    hand_frames: str = setting(
        "links",
        choices=HAND_FRAMES,
        description="What of the hand at the last grasp is published on /tf_static: all its "
        "links, for a robot model without further nodes; its root link alone, where a "
        "robot_state_publisher does the others by grasp_joint_states; or none.",
    )
    hand_frame_prefix: str = setting(
        "planned/",
        description="Stands before the links' names in those frames: without one they would be "
        "the frames of the real hand.",
    )
    marker_lifetime_s: float = setting(
        0.0,
        low=0.0,
        high=86_400.0,
        description="Time after which viewers take the markers of a grasp away; 0: with the next "
        "grasp.",
    )
    workspace_radius_m: float = setting(
        100.0,
        low=0.1,
        high=1e6,
        description="An object pose further than this from the origin of its frame is refused, "
        "as a mistake of units most likely.",
    )
    tf_tolerance_s: float = setting(
        0.2,
        low=0.0,
        high=60.0,
        description="How far an object pose's stamp may lie outside the transforms that are "
        "known of a frame; the nearest is taken.",
    )
    tf_wait_s: float = setting(
        0.1,
        low=0.0,
        high=10.0,
        description="How long a request waits for a transform that is not there yet.",
    )
    palm_flange_pose: str = setting(
        NO_FLANGE,
        description="Pose of the robot's flange in the palm's frame, x y z qx qy qz qw: "
        "flange_pose of a grasp is where that flange has to be.",
    )
    arm_frame: str = setting(
        "",
        description="Frame in which the arm's file (arm.model) gives the pose of its base.",
    )
    support_frame: str = setting(
        "",
        description="Frame of the default support plane; empty: the node assumes no support.",
    )
    support_pose: str = setting(
        "0 0 0 0 0 0 1",
        description="Pose of the default support plane, x y z qx qy qz qw: its xy-plane carries "
        "the part, its z axis points away from the support.",
    )
    obstacles_frame: str = setting("", description="Frame of the default obstacles.")
    obstacles: str = setting(
        "",
        description="Default obstacles as YAML or JSON text: the list of clearance.md; a mesh is "
        "an ID of the catalogue. Empty: none.",
    )
    diagnostics_period_s: float = setting(
        1.0, low=0.1, high=60.0, description="Time between two messages on /diagnostics."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.default_time_budget_s > self.max_time_budget_s:
            raise RequestError(
                f"Setting 'default_time_budget_s' is {self.default_time_budget_s:g}, above "
                f"'max_time_budget_s' {self.max_time_budget_s:g}. Lower the one or raise the "
                "other first."
            )
        if (self.friction_finger > 0.0) != (self.friction_palm > 0.0):
            raise RequestError(
                f"Settings 'friction_finger' {self.friction_finger:g} and 'friction_palm' "
                f"{self.friction_palm:g}: one is 0. Set both at once, or both to 0 for the part's "
                "own."
            )
        self._check_scene()
        self._check_estimates()
        if self.friction is not None:
            check_friction(self.friction_finger, "finger")
            check_friction(self.friction_palm, "palm")
        if not all(self.mesh_directories):
            raise RequestError(
                f"Setting 'mesh_directories' is {list(self.mesh_directories)!r}; it takes "
                "non-empty strings. Name directories."
            )

    def _check_scene(self) -> None:
        pose_of_text(self.support_pose, "support_pose")
        pose_of_text(self.palm_flange_pose, "palm_flange_pose")
        listed = obstacles_of(self.obstacles)
        Surroundings.from_mapping(
            {"obstacles": [near_origin(entry) for entry in listed]}, lambda _mesh_id: STAND_IN
        )
        for name in ("arm_frame", "support_frame", "obstacles_frame", "object_parent_frame"):
            frame = getattr(self, name)
            if frame and FRAME_PATTERN.fullmatch(frame) is None:
                raise RequestError(
                    f"Setting '{name}' is '{printable(frame, 60)}'; a frame has 1 to 255 letters, "
                    "digits or '_./~:-'. Give the frame's name as poses have it."
                )
        if FRAME_PATTERN.fullmatch(f"{self.hand_frame_prefix}palm") is None:
            raise RequestError(
                f"Setting 'hand_frame_prefix' is '{printable(self.hand_frame_prefix, 60)}'; it "
                "has letters, digits or '_./~:-'. Give it as frames have it, such as 'planned/'."
            )
        if listed and not self.obstacles_frame:
            raise RequestError(
                f"Setting 'obstacles' names {len(listed)}, and 'obstacles_frame' is empty. Set it "
                "to the frame of the object's poses, at once with the obstacles."
            )

    def _check_estimates(self) -> None:
        mapping_of(self.class_ids, "class_ids")
        frames = mapping_of(self.object_frames, "object_frames")
        if len(set(frames.values())) < len(frames):
            raise RequestError(
                f"Setting 'object_frames' is {list(self.object_frames)!r:.120}; it takes one frame "
                "for each part. Leave the others out: which of them holds a part cannot be told."
            )
        if self.instance_point:
            point_of_text(self.instance_point, "instance_point")
        if self.pose_type == "tf" and not (frames and self.object_parent_frame):
            raise RequestError(
                "Setting 'pose_type' is 'tf'; it needs 'object_frames', such as "
                "\"['mug_frame=mug']\", and 'object_parent_frame'. Set both at once with it."
            )

    @property
    def friction(self) -> Friction | None:
        """Coefficients that overrule the parts' own, None where nothing is set."""
        if self.friction_finger == 0.0 and self.friction_palm == 0.0:
            return None
        return Friction(finger=self.friction_finger, palm=self.friction_palm)


# Fixed when the node starts: they shape its subscriptions, threads and catalogue.
READ_ONLY = frozenset(
    {"mesh_directories", "pose_type", "queue_size", "diagnostics_period_s", "hand.model"}
)
