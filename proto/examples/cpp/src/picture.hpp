/// A picture in memory and the one shape it is painted with.
#pragma once

#include <string>

namespace simulator {

struct Colour {
  double red, green, blue;  // 0 .. 255
};

/// Returns the color that lies so far (0 .. 1) from one to another.
Colour between(Colour one, Colour other, double share);

/// Rows of pixels of three bytes each, from the top left; lengths and places in px.
class Picture {
 public:
  /// Begins with a gradient from top to bottom.
  Picture(int width, int height, Colour top, Colour bottom);

  /// Paints a box around (x, y) with round corners, over what is there. Its edge fades over `soft` px: 1 smooths it,
  /// many make a glow. A disc is a box whose halves are its radius.
  void box(double x, double y, double half_width, double half_height, double radius, Colour color, double alpha = 1,
           double soft = 1);

  void disc(double x, double y, double radius, Colour color, double alpha = 1, double soft = 1) {
    box(x, y, radius, radius, radius, color, alpha, soft);
  }

  const std::string& bytes() const { return bytes_; }

 private:
  void blend(int column, int row, Colour color, double alpha);

  int width_, height_;
  std::string bytes_;
};

}  // namespace simulator
