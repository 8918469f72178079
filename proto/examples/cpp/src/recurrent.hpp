/// What a policy that `joybridge export` wrote remembers: dense and recurrent layers. Part of network.hpp.
#pragma once

#include <cmath>
#include <numeric>
#include <vector>

#include "json.hpp"

namespace joybridge {

/// A dense layer of the file.
struct Dense {
  explicit Dense(const Json& layer) : weight(layer["weight"].floats()), bias(layer["bias"].floats()) {}

  std::vector<float> sums(const std::vector<float>& values) const {
    require(weight.size() == bias.size() * values.size());
    std::vector<float> sums = bias;
    for (std::size_t row = 0; row < sums.size(); ++row) {
      const auto from = weight.begin() + row * values.size();
      sums[row] = float(std::inner_product(values.begin(), values.end(), from, double(sums[row])));
    }
    return sums;
  }

  std::vector<float> weight, bias;
};

/// A gated recurrent unit, or a long short-term memory; or nothing, where the file has none.
class Memory {
 public:
  explicit Memory(const Json& memory)
      : cells(memory["kind"].text == "lstm"), input(memory["input"]), state(memory["state"]) {
    const std::size_t gates = cells ? 4 : 3;
    size = state.bias.size() / gates;
    require(input.bias.size() == gates * size && state.bias.size() == gates * size);
  }

  bool there() const { return size > 0; }

  /// Returns how many numbers it remembers.
  std::size_t numbers() const { return cells ? 2 * size : size; }

  /// Returns what it puts out for some features. `memory` is what it remembers, which is brought up to date.
  std::vector<float> remember(const std::vector<float>& features, std::vector<float>& memory) const {
    std::vector<float> last(memory.begin(), memory.begin() + size);
    const std::vector<float> given = input.sums(features), kept = state.sums(last);
    for (std::size_t k = 0; k < size; ++k) {
      const auto gate = [&](std::size_t number) { return given[number * size + k] + kept[number * size + k]; };
      if (cells) {
        float& cell = memory[size + k];
        cell = sigmoid(gate(1)) * cell + sigmoid(gate(0)) * std::tanh(gate(2));
        last[k] = sigmoid(gate(3)) * std::tanh(cell);
      } else {
        const float fresh = std::tanh(given[2 * size + k] + sigmoid(gate(0)) * kept[2 * size + k]);
        const float share = sigmoid(gate(1));
        last[k] = (1 - share) * fresh + share * last[k];
      }
    }
    std::copy(last.begin(), last.end(), memory.begin());
    return last;
  }

 private:
  static float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

  bool cells;
  Dense input, state;
  std::size_t size;
};

}  // namespace joybridge
