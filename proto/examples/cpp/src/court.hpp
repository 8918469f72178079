/// The sizes and the state of a court, which the rules and the pictures of paddle share.
///
/// One unit is half the width of the court; x is 0 in its middle, y is 0 at its floor.
#pragma once

#include "random.hpp"

namespace simulator {

constexpr double COURT_HEIGHT = 1.4;
constexpr double BALL_RADIUS = 0.05;
constexpr double BALL_SPEED = 1.4;                // at pace 1, per second
constexpr double SMASH = 1.7;                     // a hard hit makes the ball so much faster
constexpr double BAT_TOP = 0.12;                  // the bat returns the ball at this height
constexpr std::int64_t SWING = 8, RECOVERY = 32;  // ticks: a hard hit is possible, then the arm rests

/// The state of one arena. All members have 8 bytes, so there is no padding.
struct Court {
  Random random;
  double pace = 1;                                       // a factor of the ball's speed in this episode
  double bat = 0;                                        // x of its middle
  double x = 0, y = 0, velocity_x = 0, velocity_y = 0;   // of the ball, per second
  std::int64_t wait = 0;                                 // ticks of swing and recovery that remain
  std::int64_t decisions = 0, returns = 0, smashes = 0;  // of this episode; a smash is also a return

  bool swinging() const { return wait > RECOVERY; }
};

}  // namespace simulator
