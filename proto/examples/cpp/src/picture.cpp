#include "picture.hpp"

#include <algorithm>
#include <cmath>

namespace simulator {

Colour between(Colour one, Colour other, double share) {
  return {one.red + share * (other.red - one.red), one.green + share * (other.green - one.green),
          one.blue + share * (other.blue - one.blue)};
}

Picture::Picture(int width, int height, Colour top, Colour bottom)
    : width_(width), height_(height), bytes_(std::size_t{3} * width * height, '\0') {
  for (int row = 0; row < height; ++row) {
    const Colour color = between(top, bottom, double(row) / height);
    for (int column = 0; column < width; ++column) blend(column, row, color, 1);
  }
}

void Picture::box(double x, double y, double half_width, double half_height, double radius, Colour color, double alpha,
                  double soft) {
  const auto first = [soft](double middle, double half) { return std::max(0, int(middle - half - soft)); };
  const auto last = [soft](double middle, double half, int size) {
    return std::min(size - 1, int(middle + half + soft));
  };
  for (int row = first(y, half_height); row <= last(y, half_height, height_); ++row) {
    for (int column = first(x, half_width); column <= last(x, half_width, width_); ++column) {
      // How far the middle of the pixel is from the edge, in the direction of either side; negative inside.
      const double across = std::abs(column + 0.5 - x) - (half_width - radius);
      const double along = std::abs(row + 0.5 - y) - (half_height - radius);
      const double right = std::max(across, 0.0), up = std::max(along, 0.0);
      const double distance = std::sqrt(right * right + up * up) + std::min(std::max(across, along), 0.0) - radius;
      blend(column, row, color, alpha * std::clamp(0.5 - distance / soft, 0.0, 1.0));
    }
  }
}

void Picture::blend(int column, int row, Colour color, double alpha) {
  const double parts[] = {color.red, color.green, color.blue};
  char* pixel = &bytes_[std::size_t{3} * (std::size_t(row) * width_ + column)];
  for (int part = 0; part < 3; ++part) {
    const double before = static_cast<unsigned char>(pixel[part]);
    pixel[part] = static_cast<char>(static_cast<unsigned char>(before + alpha * (parts[part] - before) + 0.5));
  }
}

}  // namespace simulator
