/// How a policy that `joybridge export` wrote sees images: from bytes to features. Part of network.hpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "json.hpp"

namespace joybridge {

using Activation = std::function<float(float)>;

inline constexpr std::size_t MAX_NUMBERS = 1 << 24;  // of a sensor, of a picture, and of all that is remembered

/// Numbers in channels of rows and columns.
struct Planes {
  std::size_t channels, height, width;
  std::vector<float> values;
};

/// One step of an encoder: a convolution, the maximum of each channel, an activation, or a residual of other steps.
struct EncoderStep {
  explicit EncoderStep(const Json& step)
      : kind(step["kind"].text), weight(step["weight"].floats()), bias(step["bias"].floats()) {
    for (const Json& inner : step["steps"].items) steps.emplace_back(inner);
    if (kind == "activation" || kind == "residual") return;
    rows = step["size"].items.at(0).place();
    columns = step["size"].items.at(1).place();
    stride = step["stride"].place();
    padding = step["padding"].place();
    require(rows && columns && stride && padding <= MAX_PADDING);
  }

  Planes run(Planes image, const Activation& activate) const {
    if (kind == "activation") {
      for (float& value : image.values) value = activate(value);
    } else if (kind == "residual") {
      Planes inner = image;
      for (const EncoderStep& step : steps) inner = step.run(std::move(inner), activate);
      for (std::size_t k = 0; k < image.values.size(); ++k) image.values[k] += inner.values.at(k);
    } else {
      return slide(image);
    }
    return image;
  }

 private:
  static constexpr std::size_t MAX_PADDING = 100;

  /// Returns the weighted sum of all channels in each window, or without weights the maximum of each channel.
  Planes slide(const Planes& image) const {
    const std::size_t outputs = weight.empty() ? image.channels : bias.size();
    require(image.height + 2 * padding >= rows && image.width + 2 * padding >= columns &&
            (weight.empty() || weight.size() == outputs * image.channels * rows * columns));
    Planes result{outputs, (image.height + 2 * padding - rows) / stride + 1,
                  (image.width + 2 * padding - columns) / stride + 1, {}};
    require(outputs * result.height * result.width <= MAX_NUMBERS);
    for (std::size_t output = 0; output < outputs; ++output) {
      for (std::size_t y = 0; y < result.height; ++y) {
        for (std::size_t x = 0; x < result.width; ++x) {
          result.values.push_back(window(image, output, y * stride, x * stride));
        }
      }
    }
    return result;
  }

  /// Returns the same of one window, by its corner in the padded image.
  float window(const Planes& image, std::size_t output, std::size_t top, std::size_t left) const {
    const bool sums = !weight.empty();
    double total = sums ? bias[output] : -INFINITY;
    for (std::size_t channel = sums ? 0 : output; channel < (sums ? image.channels : output + 1); ++channel) {
      for (std::size_t y = std::max(top, padding); y < std::min(top + rows, image.height + padding); ++y) {
        for (std::size_t x = std::max(left, padding); x < std::min(left + columns, image.width + padding); ++x) {
          const double value = image.values[(channel * image.height + y - padding) * image.width + x - padding];
          const std::size_t place = ((output * image.channels + channel) * rows + y - top) * columns + x - left;
          total = sums ? total + weight[place] * value : std::max(total, value);
        }
      }
    }
    return float(total);
  }

  std::string kind;
  std::vector<float> weight, bias;
  std::vector<EncoderStep> steps;  // of a residual
  std::size_t rows = 0, columns = 0, stride = 0, padding = 0;
};

/// How much each channel of an image finds after a step, and where.
struct Moments {
  explicit Moments(const Json& moments) : step(moments["step"].place()), grid(moments["grid"].floats()) {
    require(moments["step"].there());
  }

  /// Returns x, then y, then mass of each channel.
  std::vector<float> of(const Planes& seen) const {
    const std::size_t size = seen.height * seen.width;
    require(grid.size() == 2 * size);
    std::vector<float> result(3 * seen.channels);
    for (std::size_t channel = 0; channel < seen.channels; ++channel) {
      double mass = 0, x = 0, y = 0;
      for (std::size_t k = 0; k < size; ++k) {
        const double value = seen.values.at(channel * size + k);
        mass += value * value;
        x += value * value * grid[k];
        y += value * value * grid[size + k];
      }
      result[channel] = float(x / (mass + FAINT));
      result[seen.channels + channel] = float(y / (mass + FAINT));
      result[2 * seen.channels + channel] = float(mass / (mass + 1));
    }
    return result;
  }

  std::size_t step;

 private:
  static constexpr double FAINT = 0.1;  // what has this mass is placed half way between where it is and the middle

  std::vector<float> grid;
};

/// What a map sees of its cells in an image after a step: how much of each place.
struct Place {
  explicit Place(const Json& place)
      : image(place["image"].place()), step(place["step"].place()), channels(place["channels"].place()),
        weight(place["weight"].floats()) {}

  /// Adds to the logits of the cells. `wanted`: a weight for each channel.
  void point(const Planes& seen, const float* wanted, std::vector<float>& logits) const {
    const std::size_t size = seen.height * seen.width;
    require(seen.channels == channels && weight.size() == logits.size() * size);
    for (std::size_t k = 0; k < size; ++k) {
      double found = 0;
      for (std::size_t channel = 0; channel < channels; ++channel) {
        found += double(wanted[channel]) * seen.values.at(channel * size + k);
      }
      for (std::size_t cell = 0; cell < logits.size(); ++cell) logits[cell] += float(weight[cell * size + k] * found);
    }
  }

  std::size_t image, step, channels;

 private:
  std::vector<float> weight;
};

/// How a network sees an image.
struct ImageEncoder {
  explicit ImageEncoder(const Json& image)
      : sensor(image["sensor"].text), white(image["white"].number), height(image["shape"].items.at(0).place()),
        width(image["shape"].items.at(1).place()), channels(image["shape"].items.at(2).place()) {
    require(height * width <= MAX_NUMBERS && size() <= MAX_NUMBERS);  // none of the products is cut off
    for (const Json& step : image["steps"].items) steps.emplace_back(step);
    for (const Json& each : image["moments"].items) moments.emplace_back(each);
  }

  /// Returns the numbers of one picture.
  std::size_t size() const { return height * width * channels; }

  /// Returns the last pictures, [pictures, height, width, channels], after each step.
  std::vector<Planes> see(const std::vector<float>& stack, const Activation& activate) const {
    Planes image{stack.size() / (height * width), height, width, std::vector<float>(stack.size())};
    for (std::size_t k = 0; k < stack.size(); ++k) {
      const std::size_t channel = k / size() * channels + k % channels, pixel = k % size() / channels;
      image.values[channel * height * width + pixel] = stack[k] / white;
    }
    std::vector<Planes> after;
    for (const EncoderStep& step : steps) after.push_back(step.run(after.empty() ? image : after.back(), activate));
    require(!after.empty());
    return after;
  }

  std::string sensor;
  std::vector<Moments> moments;

 private:
  float white;
  std::size_t height, width, channels;
  std::vector<EncoderStep> steps;
};

}  // namespace joybridge
