#include "paddle.hpp"

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "court.hpp"
#include "drawing.hpp"
#include "refusal.hpp"

namespace simulator {
namespace {

constexpr double TICK = 1.0 / 60;               // s
constexpr int TICKS = 4;                        // of a decision
constexpr std::int64_t DECISIONS = 300;         // length at which an episode is truncated
constexpr double BAT_SPEED = 1.8;               // at full axis, per second
constexpr double WIDE = 0.2, NARROW = 0.12;     // half the width of a bat
constexpr double SLOWEST = 0.5, FASTEST = 1.5;  // paces
constexpr double TOP_SPEED = BALL_SPEED * FASTEST * SMASH;

// Where the middle of the ball turns round: at a side, at the top, at the bat.
constexpr double WALL = 1 - BALL_RADIUS, CEILING = COURT_HEIGHT - BALL_RADIUS, LINE = BAT_TOP + BALL_RADIUS;

/// The spec in protobuf's text format, but for the numbers that are constants above.
constexpr char SPEC[] = R"(
  name: "paddle"
  description: "Keep the ball in the air, and hit it hard at the right moment."
  options {
    name: "bat"
    description: "how much of the court it covers: a fifth or an eighth"
    choices: ["wide", "narrow"]
    default_choice: "wide"
  }
  parameters { name: "pace" description: "a factor of the ball's speed" default_value: 1 }
  behaviors {
    name: "player"
    description: "moves the bat and swings it"
    agents_per_arena: 1
    sensors {
      name: "ball"
      description: "x from wall to wall, height from floor to ceiling; 1 is the highest speed that there is"
      dtype: DTYPE_FLOAT32
      shape: 4
      elements: ["x", "height", "velocity_x", "velocity_y"]
      low: [-1, 0, -1, -1]
      high: 1
    }
    sensors {
      name: "bat"
      description: "x from wall to wall; how long until the next swing, 0 being now"
      dtype: DTYPE_FLOAT32
      shape: 2
      elements: ["x", "wait"]
      low: [-1, 0]
      high: 1
    }
    device {
      axes { name: "move" description: "left to right" low: -1 high: 1 kind: AXIS_KIND_VELOCITY way: WAY_RIGHT }
      branches {
        name: "swing" description: "masked until the last one is over"
        choices: ["released", "pressed"] keys: ["", "Space"]
      }
    }
    channels { name: "returns" description: "the ball was returned" default_weight: 1 }
    channels { name: "smashes" description: "and that by a swing" default_weight: 1 }
    channels { name: "swings" description: "a swing was begun, which is tiring" default_weight: -0.2 }
    channels { name: "losses" description: "the ball was lost" default_weight: -1 }
    metrics { name: "returns" description: "in the episode" }
    metrics { name: "smashes" description: "returns by a swing" }
  }
  max_arenas: 1024
)";

/// One arena.
class Match final : public Arena {
 public:
  Match(double half_bat, std::uint64_t seed, std::uint64_t number) : half_bat_(half_bat) {
    now_.random = {seed, number, 0};
  }

  void begin(const Parameters& parameters) override {
    now_ = {.random = now_.random, .pace = parameters.at("pace"), .y = CEILING};
    now_.x = now_.random.uniform(-0.8, 0.8);
    send(now_.random.uniform(-0.5, 0.5), -BALL_SPEED);
  }

  TimeStep step(const Action& action) override {
    const Court before = now_;
    const bool swing = action.choices[0] == 1;  // its mask allows that only when the arm has rested
    if (swing) now_.wait = SWING + RECOVERY;
    bool lost = false;
    for (int tick = 0; tick < TICKS && !lost; ++tick) {
      now_.bat = std::clamp(now_.bat + BAT_SPEED * TICK * action.axes[0], half_bat_ - 1, 1 - half_bat_);
      fly();
      lost = now_.y < 0;
      now_.wait = std::max<std::int64_t>(now_.wait - 1, 0);
    }
    now_.decisions += 1;
    TimeStep result;
    result.rewards = {float(now_.returns - before.returns), float(now_.smashes - before.smashes), float(swing),
                    float(lost)};
    result.end = lost ? End::terminated : now_.decisions == DECISIONS ? End::truncated : End::none;
    result.metrics = {float(now_.returns), float(now_.smashes)};
    return result;
  }

  std::vector<std::vector<float>> observe() const override {
    const double height = std::max(now_.y, 0.0) / COURT_HEIGHT;  // a lost ball is below the floor
    return {{float(now_.x), float(height), float(now_.velocity_x / TOP_SPEED), float(now_.velocity_y / TOP_SPEED)},
            {float(now_.bat), float(now_.wait) / (SWING + RECOVERY)}};
  }

  std::vector<std::vector<bool>> masks() const override { return {{true, now_.wait == 0}}; }

  std::string draw() const override { return simulator::draw(now_, half_bat_); }

  std::string save() const override { return {reinterpret_cast<const char*>(&now_), sizeof now_}; }

  void restore(const std::string& state) override {
    std::memcpy(&now_, state.data(), sizeof now_);
    check("pace", now_.pace, SLOWEST, FASTEST);
    check("bat", now_.bat, half_bat_ - 1, 1 - half_bat_);
    check("x", now_.x, -WALL, WALL);
    check("y", now_.y, 0, CEILING);
    check("velocity_x", now_.velocity_x, -TOP_SPEED, TOP_SPEED);
    check("velocity_y", now_.velocity_y, -TOP_SPEED, TOP_SPEED);
    check("wait", double(now_.wait), 0, SWING + RECOVERY);
    check("decisions", double(now_.decisions), 0, DECISIONS - 1);
    check("returns", double(now_.returns), 0, DECISIONS);
    check("smashes", double(now_.smashes), 0, double(now_.returns));
  }

 private:
  /// Moves the ball for a tick: it bounces from the walls, the ceiling and the bat.
  void fly() {
    const double before = now_.y;
    now_.x += TICK * now_.velocity_x;
    now_.y += TICK * now_.velocity_y;
    if (std::abs(now_.x) > WALL) {
      now_.x = std::copysign(2 * WALL, now_.x) - now_.x;
      now_.velocity_x = -now_.velocity_x;
    }
    if (now_.y > CEILING) {
      now_.y = 2 * CEILING - now_.y;
      now_.velocity_y = -now_.velocity_y;
    }
    const double beside = (now_.x - now_.bat) / (half_bat_ + BALL_RADIUS);  // -1 and 1 are the ends of the bat
    if (before >= LINE && now_.y < LINE && std::abs(beside) <= 1) {
      now_.y = 2 * LINE - now_.y;
      now_.returns += 1;
      now_.smashes += now_.swinging();
      send(0.6 * beside + now_.random.uniform(-0.2, 0.2), now_.swinging() ? SMASH * BALL_SPEED : BALL_SPEED);
    }
  }

  /// Gives the ball a speed, up or down, of which a share in -1 .. 1 goes sideways.
  void send(double share, double speed) {
    now_.velocity_x = now_.pace * std::abs(speed) * share;
    now_.velocity_y = now_.pace * speed * std::sqrt(1 - share * share);
  }

  static void check(const char* what, double value, double low, double high) {
    if (value >= low && value <= high) return;  // false for NaN
    throw std::invalid_argument(text(what, " is ", value, ", expected ", low, "..", high));
  }

  const double half_bat_;
  Court now_ = {};
};

}  // namespace

pb::GameSpec Paddle::describe(const Options&) const {
  pb::GameSpec spec;
  if (!google::protobuf::TextFormat::ParseFromString(SPEC, &spec)) throw std::logic_error("SPEC is no GameSpec");
  spec.mutable_parameters(0)->set_low(SLOWEST);
  spec.mutable_parameters(0)->set_high(FASTEST);
  spec.set_decision_interval(TICKS);
  spec.set_tick_seconds(TICK);
  spec.set_max_episode_decisions(DECISIONS);
  spec.mutable_picture()->set_width(WIDTH);
  spec.mutable_picture()->set_height(HEIGHT);
  spec.set_snapshot_bytes_per_arena(sizeof(Court) + SESSION_BYTES);
  return spec;
}

std::unique_ptr<Arena> Paddle::open(const Options& options, std::uint64_t seed, std::uint64_t number) const {
  return std::make_unique<Match>(options.at("bat") == "wide" ? WIDE : NARROW, seed, number);
}

}  // namespace simulator
