/// Play a policy that `joybridge export RUN policy.json` wrote. Copy this file, network.hpp,
/// recurrent.hpp, convolutions.hpp and json.hpp; they need C++20 alone.
///
///   const joybridge::Policy policy("policy.json");
///   const joybridge::Noise noise = joybridge::seeded(7);
///   joybridge::State state = policy.begin();  // again for the next episode
///   const auto action = policy.act({{"target", {0.1, -0.3}}, {"bow", {1}}}, state, noise, {{"draw", {true, false}}});
///
/// It plays one agent. Decide when the game lets the agent decide; if it waits with the first observation of an episode,
/// call `watch` with it.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "json.hpp"
#include "network.hpp"

namespace joybridge {

using Masks = std::map<std::string, std::vector<bool>>;  // by name of a branch; true: allowed
using State = std::vector<std::vector<float>>;           // for each network, what it remembers

/// The values of the device: one for each axis and each branch, in the order of the file.
struct Action {
  std::vector<float> axes;
  std::vector<int> choices;
};

/// Where a policy that is not deterministic takes its noise: uniform in [0, 1), and standard normal.
struct Noise {
  std::function<double()> uniform, normal;
};

/// Returns the noise of a seed.
inline Noise seeded(std::mt19937_64::result_type seed) {
  const auto random = std::make_shared<std::mt19937_64>(seed);
  return {[random] { return ((*random)() >> 11) * 0x1p-53; }, [random] { return std::normal_distribution()(*random); }};
}

/// What plays one behavior of a game: its device, and the networks that share it.
class Policy {
 public:
  explicit Policy(const std::string& path) : document(Json::read(path)) {
    require(document["format"].text == "joybridge.policy.v5",
            path + " is no policy; write it with `joybridge export RUN policy.json`");
    for (const Json& axis : document["axes"].items) require(axis["low"].number <= axis["high"].number);
    for (const Json& network : document["policies"].items) networks_.emplace_back(network, document["sensors"]);
  }

  const Json document;  // the file: its `game`, `options`, `sensors`, `axes`, `branches` and more

  /// Returns the state of a new episode, in which no network remembers anything.
  State begin() const {
    State state;
    for (const Network& network : networks_) state.emplace_back(network.remembers());
    return state;
  }

  /// Advances the state by an observation with which the agent waits, the first of an episode.
  void watch(const Sensors& sensors, State& state) const {
    for (std::size_t index = 0; index < networks_.size(); ++index) networks_[index].watch(sensors, state.at(index));
  }

  /// Returns what to do, and advances the state; a branch without a mask allows all. Throws std::logic_error.
  Action act(const Sensors& sensors, State& state, const Noise& noise, const Masks& masks = {}) const {
    const std::vector<Json>&axes = document["axes"].items, &branches = document["branches"].items;
    Action action{std::vector<float>(axes.size()), std::vector<int>(branches.size())};
    std::vector<std::vector<bool>> allowed;
    for (const Json& branch : branches) {
      const auto mask = masks.find(branch["name"].text);
      allowed.push_back(mask == masks.end() ? std::vector<bool>(branch["choices"].items.size(), true) : mask->second);
    }
    const bool sampled = document["deterministic"].text == "false";
    for (std::size_t index = 0; index < networks_.size(); ++index) {
      const Network& network = networks_[index];
      const std::vector<float> outputs = network.decide(sensors, state.at(index));
      std::size_t rows = network.deviations.size();
      for (const Json& table : network.json["discrete"].items) rows += table["values"].items.size();
      require(outputs.size() == rows);
      for (const float value : outputs) require(std::isfinite(value), "a sensor is not finite, or the policy is damaged");
      auto output = outputs.begin();
      for (const Json& table : network.json["discrete"].items) {
        const std::size_t count = table["values"].items.size();
        const std::size_t row = choose(table, {output, output + count}, allowed, sampled ? noise.uniform() : -1);
        output += count;
        if (table["axis"].there()) action.axes.at(table["axis"].place()) = float(table["values"].items[row].number);
        set(action.choices, table["branches"], table["values"].items[row]);
        if (table["axes"].there()) set(action.axes, table["axes"], table["positions"].items.at(row));
      }
      for (std::size_t k = 0; k < network.deviations.size(); ++k) {
        const Json& target = network.json["continuous"].items.at(k);
        const double sample = output[k] + (sampled ? network.deviations[k] * noise.normal() : 0);
        const double share = target["squashed"].there() ? std::tanh(sample) : std::clamp(sample / 3, -1.0, 1.0);
        if (target["axis"].there()) {
          const std::size_t axis = target["axis"].place();
          const double low = axes.at(axis)["low"].number, high = axes.at(axis)["high"].number;
          action.axes[axis] = float(std::clamp((low + high + (high - low) * share) / 2, low, high));
        } else {
          const std::vector<bool>& mask = allowed.at(target["branch"].place());
          const std::size_t choice = press(share, target["threshold"], mask.size());
          const std::size_t first = std::find(mask.begin(), mask.end(), true) - mask.begin();
          action.choices.at(target["branch"].place()) = int(mask.at(choice) ? choice : first);
        }
      }
    }
    return action;
  }

 private:
  /// Returns a row of a table, never one with a masked choice; `uniform`: noise, or -1 for the likeliest row.
  static std::size_t choose(const Json& table, std::vector<double> logits,
                            const std::vector<std::vector<bool>>& allowed, double uniform) {
    const std::vector<Json>& branches = table["branches"].items;
    for (std::size_t row = 0; row < logits.size(); ++row) {
      for (std::size_t column = 0; column < branches.size(); ++column) {
        const std::size_t choice = table["values"].items[row].items.at(column).place();
        if (!allowed.at(branches[column].place()).at(choice)) logits[row] = -1e9;
      }
    }
    require(!logits.empty());
    const auto likeliest = std::max_element(logits.begin(), logits.end());
    if (uniform < 0) return likeliest - logits.begin();
    double total = 0;
    for (double highest = *likeliest; double& logit : logits) logit = total += std::exp(logit - highest);
    const auto row = std::upper_bound(logits.begin(), logits.end(), uniform * total);
    return (row == logits.end() ? likeliest : row) - logits.begin();  // rounded up to the total
  }

  /// Returns the choice of a branch of `count` choices at a share in -1 .. 1.
  static std::size_t press(double share, const Json& threshold, std::size_t count) {
    if (!threshold.there()) return std::min(std::size_t((share + 1) / 2 * count), count - 1);
    return threshold.number == 0 ? share > 0 : std::abs(share) < threshold.number;
  }

  /// Gives the axes or branches at some places their values.
  template <typename T>
  static void set(std::vector<T>& device, const Json& places, const Json& values) {
    std::size_t k = 0;
    for (const Json& place : places.items) device.at(place.place()) = T(values.items.at(k++).number);
  }

  std::vector<Network> networks_;
};

}  // namespace joybridge
