/// The network of a policy that `joybridge export` wrote: from sensors to the outputs of its last layer.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "convolutions.hpp"
#include "json.hpp"
#include "recurrent.hpp"

namespace joybridge {

using Sensors = std::map<std::string, std::vector<float>>;  // by name, each flat, row-major

/// A network of the file, with its arrays decoded.
class Network {
 public:
  /// sensors: those of the file.
  Network(const Json& network, const Json& sensors) : json(network) {
    for (const Json& sensor : sensors.items) {
      std::size_t& size = sizes[sensor["name"].text] = 1;
      for (const Json& side : sensor["shape"].items) require((size *= side.place()) <= MAX_NUMBERS);
    }
    for (const Json& image : json["images"].items) {
      images.emplace_back(image);
      require(images.back().size() && sizes.at(images.back().sensor) == images.back().size());
    }
    require(frames && frames <= MAX_NUMBERS && remembers() <= MAX_NUMBERS && scale.size() == shift.size());
    require(!json["scaling"]["limit"].there() || json["scaling"]["limit"].number >= 0);
    for (const float deviation : deviations) require(std::isfinite(deviation));
    for (const Json& layer : json["layers"].items) layers.emplace_back(layer);
    for (const Json& table : json["discrete"].items) {
      places.emplace_back();
      for (const Json& place : table["places"].items) places.back().emplace_back(place);
    }
  }

  /// Returns how many numbers it remembers: of frames, of the pictures of each image, and of its memory.
  std::size_t remembers() const {
    std::size_t numbers = 0;
    for (const Json& name : json["sensors"].items) numbers += sizes.at(name.text);
    for (const ImageEncoder& image : images) numbers += image.size();
    return numbers * (frames - 1) + memory.numbers();
  }

  /// Returns the logits of all tables, and what follows. `state` is what it remembers, which is brought up to date.
  std::vector<float> decide(const Sensors& sensors, std::vector<float>& state) const {
    std::vector<std::vector<Planes>> seen;
    std::vector<float> values = see(sensors, state, seen);
    for (std::size_t layer = 0; layer < layers.size(); ++layer) {
      for (float& value : values) value = layer ? activate(value) : value;
      if (memory.there() && layer + 1 == layers.size()) {
        std::vector<float> remembered(state.end() - memory.numbers(), state.end());
        values = memory.remember(values, remembered);
        std::copy(remembered.begin(), remembered.end(), state.end() - memory.numbers());
      }
      values = layers[layer].sums(values);
    }
    return point(values, seen);
  }

  /// Brings all of `older` up to date but its memory.
  void watch(const Sensors& sensors, std::vector<float>& older) const {
    std::vector<std::vector<Planes>> seen;
    see(sensors, older, seen);
  }

  /// Returns what the layers get, and adds to `seen` each image after each of its steps. Brings all of `older` up
  /// to date but its memory.
  std::vector<float> see(const Sensors& sensors, std::vector<float>& older,
                         std::vector<std::vector<Planes>>& seen) const {
    if (older.size() != remembers()) throw std::invalid_argument("the policy needs a state of another size");
    std::vector<float> frame, kept;
    for (const Json& name : json["sensors"].items) append(frame, find(sensors, name.text));
    const float limit = json["scaling"]["limit"].there() ? float(json["scaling"]["limit"].number) : INFINITY;
    for (std::size_t k = 0; k < scale.size(); ++k) {
      frame.at(k) = std::clamp((frame[k] - shift.at(k)) * scale[k], -limit, limit);
    }
    std::vector<float> values = stack(frame, older, kept);
    for (const ImageEncoder& image : images) {
      seen.push_back(image.see(stack(find(sensors, image.sensor), older, kept), activate));
      append(values, seen.back().back().values);
      for (const Moments& each : image.moments) append(values, each.of(seen.back().at(each.step)));
    }
    std::copy(kept.begin(), kept.end(), older.begin());
    return values;
  }

  const Json json;
  const std::vector<float> deviations = json["deviations"].floats();

 private:
  /// Returns outputs in which what a map looks for, a weight for each channel, has become the logits of its cells.
  std::vector<float> point(const std::vector<float>& outputs, const std::vector<std::vector<Planes>>& seen) const {
    std::vector<float> values;
    std::size_t begin = 0;
    for (std::size_t table = 0; table < places.size(); ++table) {
      std::vector<float> logits(json["discrete"].items[table]["values"].items.size());
      for (const Place& place : places[table]) {
        require(begin + place.channels <= outputs.size());
        place.point(seen.at(place.image).at(place.step), outputs.data() + begin, logits);
        begin += place.channels;
      }
      if (places[table].empty()) {
        require(begin + logits.size() <= outputs.size());
        std::copy_n(outputs.begin() + begin, logits.size(), logits.begin());
        begin += logits.size();
      }
      append(values, logits);
    }
    values.insert(values.end(), outputs.begin() + begin, outputs.end());
    return values;
  }

  /// Returns the last frames or pictures, oldest first. All but the oldest are added to `kept`.
  std::vector<float> stack(const std::vector<float>& newest, const std::vector<float>& older,
                           std::vector<float>& kept) const {
    const auto begin = older.begin() + kept.size();
    std::vector<float> seen(begin, begin + newest.size() * (frames - 1));
    append(seen, newest);
    kept.insert(kept.end(), seen.begin() + newest.size(), seen.end());
    return seen;
  }

  const std::vector<float>& find(const Sensors& sensors, const std::string& name) const {
    const auto sensor = sensors.find(name);
    if (sensor == sensors.end()) throw std::invalid_argument("the policy needs the sensor '" + name + "'");
    if (sensor->second.size() != sizes.at(name)) throw std::invalid_argument("'" + name + "' has another size");
    return sensor->second;
  }

  static void append(std::vector<float>& values, const std::vector<float>& more) {
    values.insert(values.end(), more.begin(), more.end());
  }

  static Activation activation(const std::string& name) {
    if (name == "swish") return [](float x) { return x / (1 + std::exp(-x)); };
    if (name == "tanh") return [](float x) { return std::tanh(x); };
    if (name == "relu") return [](float x) { return std::max(x, 0.0F); };
    return [](float x) { return x > 0 ? x : std::expm1(x); };
  }

  std::map<std::string, std::size_t> sizes;  // numbers of each sensor
  std::vector<ImageEncoder> images;
  std::vector<Dense> layers;
  std::vector<std::vector<Place>> places;  // of each table; of a map alone
  Memory memory = Memory(json["memory"]);
  std::vector<float> shift = json["scaling"]["shift"].floats(), scale = json["scaling"]["scale"].floats();
  std::size_t frames = json["frame_stack"].place();
  Activation activate = activation(json["activation"].text);
};

}  // namespace joybridge
