"""The settings of one policy: what it observes, what it remembers, its rewards, and how it learns."""

from typing import Annotated, Literal

from pydantic import Field

from joybridge.config.parameter_keys import Checked

CODE = r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$"  # module:name

Schedule = Literal["linear", "constant"]


class MemoryConfig(Checked):
    """What one policy remembers of an episode."""

    kind: Literal["none", "gru", "lstm"] = Field("none", description="a recurrent layer behind the hidden layers")
    size: int = Field(64, ge=1, le=65_536, description="units of it")
    length: int = Field(32, ge=1, description="decisions through which gradients flow back in time")


class PolicyConfig(Checked):
    """What one policy observes, its rewards, and how it learns."""

    sensors: list[str] | None = Field(None, min_length=1, description="names of the sensors it sees; null: all")
    reward_weights: dict[str, float] = Field({}, description="weights of reward channels; others as in the game")
    penalty_ramp: int = Field(
        0,
        ge=0,
        description="timesteps over which negative rewards grow from a tenth to their weight; against "
        "policies that learn to do nothing, because a miss costs and hits are rare at first",
    )
    scale_observations: Literal["none", "bounds", "running"] = Field(
        "none", description="bounds: from those of the sensors to -1..1; running: by mean and deviation in training"
    )
    scale_rewards: bool = Field(False, description="divide rewards by the deviation of the returns so far")
    image_encoder: Literal["auto", "none", "windows", "moments", "simple", "nature", "impala"] = Field(
        "auto",
        description="convolutions over images; auto: windows, over what the game calls an image; moments: these, and "
        "where their maps find something, as numbers; none: pixels are plain numbers",
    )
    network: str | None = Field(
        None, pattern=CODE, description="MODULE:CLASS, a torch.nn.Module of your own from sensors to features"
    )
    shared_encoder: bool = Field(
        True,
        description="actor and critic share the convolutions, or `network`; false: one each, if they share no body",
    )
    frame_stack: int = Field(3, ge=1, le=1000, description="observations it sees at once, oldest first")
    frame_differences: bool = Field(
        False,
        description="its convolutions learn from what changes between the frames of images, beside the newest "
        "frame: where small things move in front of a background that stands still",
    )
    remember_acts: int = Field(
        0, ge=0, le=1000, description="last actions and rewards that it sees beside the sensors, oldest first"
    )
    hidden_sizes: list[Annotated[int, Field(ge=1, le=65_536)]] = Field(
        [100, 100], min_length=1, description="units per hidden layer"
    )
    activation: Literal["swish", "tanh", "relu", "elu"] = Field("swish", description="of the hidden layers")
    memory: MemoryConfig = Field(MemoryConfig(), description="what it remembers of an episode")
    shared_body: bool | None = Field(
        None, description="one body for actor and critic; null: only if no action is continuous"
    )
    ortho_init: bool = Field(
        False,
        description="begin with orthogonal weights, of gain √2, policy heads 0.01, value 1; false: from a "
        "truncated normal, as ML-Agents",
    )
    log_std_init: float | dict[str, float] = Field(
        0.0,
        description="logarithm of the deviation that Gaussians begin with, in thirds of half an axis's range, of "
        "all or by the names of axes; 1.0986, log 3: half the range",
    )
    rollout_steps: int = Field(59, ge=1, le=2**24, description="decisions per lane between two updates")
    time_horizon: int = Field(59, ge=1, description="decisions after which advantages are cut")
    minibatch_size: int = Field(256, ge=1, description="timesteps per step of the optimizer")
    epochs: int = Field(4, ge=1, description="how often an update goes through its rollout")
    learning_rate: float = Field(3.25e-4, gt=0, description="step size of Adam")
    adam_eps: float = Field(1e-8, gt=0, description="what Adam adds to its denominators")
    weight_decay: float = Field(
        0.0,
        ge=0,
        description="of AdamW: each step multiplies all parameters by 1 - learning_rate * weight_decay",
    )
    learning_rate_schedule: Schedule = Field("linear", description="linear: falls to 1e-10 at the end of the run")
    entropy_coef: float = Field(0.05, ge=0, description="coefficient of the entropy bonus")
    entropy_coef_schedule: Schedule = Field("linear", description="linear: falls to 1e-5 at the end of the run")
    entropy: Literal["sum", "mean"] = Field(
        "mean",
        description="of a decision, over its continuous actions; over branches it is always the sum. With sum, "
        "one `entropy_coef` means the same for axes and branches",
    )
    clip_range: float = Field(0.2, gt=0, lt=1, description="clip range of PPO")
    clip_range_schedule: Schedule = Field("linear", description="linear: falls to 0.1 at the end of the run")
    normalize_advantage: Literal["rollout", "minibatch", "none"] = Field(
        "rollout", description="of what advantages get mean 0 and deviation 1"
    )
    vf_coef: float = Field(0.5, ge=0, description="coefficient of the mean squared error of values")
    clip_vloss: bool = Field(True, description="values clip as the policy does, by the same range")
    max_grad_norm: float | None = Field(
        None, gt=0, description="longest gradient of the whole network; a longer one is shortened to it"
    )
    target_kl: float | None = Field(
        None, gt=0, description="an update ends early, after an epoch whose mean KL divergence is larger"
    )
    gamma: float = Field(0.99, ge=0, le=1, description="discount of rewards per decision")
    gae_lambda: float = Field(0.95, ge=0, le=1, description="lambda of generalized advantage estimation")
    cloning_coef: float = Field(
        1.0, ge=0, description="coefficient of the loss of cloning; beside PPO it falls linearly, to 0"
    )
    only_with: bool = Field(
        True, description="leave axes that count only with a choice out of the loss where they do not count"
    )
    loss: str | None = Field(
        None, pattern=CODE, description="MODULE:FUNCTION, a term of your own that is added to the loss"
    )
    threads: int = Field(
        1, ge=1, le=64, description="that compute the gradient; more than 1 pay if no other run needs the cores"
    )
    autograd: bool = Field(False, description="take gradients from autograd, the reference, not from their closed form")

    def shares_body(self, continuous: int) -> bool:
        """Return whether actor and critic are one body, of a policy with so many continuous actions."""
        return continuous == 0 if self.shared_body is None else self.shared_body
