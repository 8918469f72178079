/// Pictures of paddle.
#pragma once

#include <string>

#include "court.hpp"

namespace simulator {

constexpr int WIDTH = 400, HEIGHT = 300;  // px

/// Returns a picture of a court: HEIGHT * WIDTH * 3 bytes.
std::string draw(const Court& court, double half_bat);

}  // namespace simulator
