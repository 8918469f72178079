#include "scores.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "policy.hpp"
#include "settings.hpp"

namespace simulator {
namespace {

/// Plays an episode and returns its reward, its length and its metrics.
std::vector<double> play(const joybridge::Policy& policy, const joybridge::Noise& noise, const pb::Behavior& behavior,
                         Arena& arena) {
  double reward = 0, length = 0;
  joybridge::State state = policy.begin();
  TimeStep step;
  while (step.end == End::none) {
    const auto observed = arena.observe();
    const auto allowed = arena.masks();
    joybridge::Sensors sensors;
    joybridge::Masks masks;
    for (int k = 0; k < behavior.sensors_size(); ++k) sensors[behavior.sensors(k).name()] = observed[k];
    for (int k = 0; k < behavior.device().branches_size(); ++k) {
      masks[behavior.device().branches(k).name()] = allowed[k];
    }
    const joybridge::Action action = policy.act(sensors, state, noise, masks);
    step = arena.step({action.axes, action.choices});
    for (int k = 0; k < behavior.channels_size(); ++k) {
      reward += behavior.channels(k).default_weight() * step.rewards[k];
    }
    length += 1;
  }
  std::vector<double> row = {reward, length};
  row.insert(row.end(), step.metrics.begin(), step.metrics.end());
  return row;
}

/// Returns whether a policy acts on a device: on its axes, and on its branches with their choices.
bool fits(const joybridge::Json& policy, const pb::Device& device) {
  const auto &axes = policy["axes"].items, &branches = policy["branches"].items;
  return std::equal(axes.begin(), axes.end(), device.axes().begin(), device.axes().end(),
                    [](const auto& ours, const auto& theirs) { return ours["name"].text == theirs.name(); }) &&
         std::equal(branches.begin(), branches.end(), device.branches().begin(), device.branches().end(),
                    [](const auto& ours, const auto& theirs) {
                      return ours["name"].text == theirs.name() &&
                             int(ours["choices"].items.size()) == theirs.choices_size();
                    });
}

/// Returns a line with the mean of a column.
std::string line(const std::string& name, const std::vector<std::vector<double>>& rows, std::size_t column) {
  const double count = double(rows.size());
  double sum = 0, squares = 0;
  for (const auto& row : rows) sum += row[column];
  for (const auto& row : rows) squares += std::pow(row[column] - sum / count, 2);
  char numbers[64];
  const double half = 1.96 * std::sqrt(squares / std::max(count - 1, 1.0) / count);
  std::snprintf(numbers, sizeof numbers, "%10.3f ± %.3f", sum / count, half);
  return "\n  " + name + std::string(name.size() < 17 ? 17 - name.size() : 1, ' ') + numbers;
}

}  // namespace

std::string scores(const Games& games, const std::string& file, int episodes, std::uint64_t seed) {
  const joybridge::Policy policy(file);
  const joybridge::Json& trained = policy.document["options"];
  google::protobuf::Map<std::string, std::string> options;
  for (std::size_t k = 0; k < trained.names.size(); ++k) options[trained.names[k]] = trained.items[k].text;
  const Chosen chosen = choose(games, policy.document["game"].text, options);
  const pb::Behavior& behavior = chosen.spec.behaviors(0);
  joybridge::require(fits(policy.document, behavior.device()), file + " acts on another device than the game has");
  const joybridge::Noise noise = joybridge::seeded(seed);
  const auto arena = chosen.game.open(chosen.options, seed, 0);
  std::vector<std::vector<double>> rows;
  for (int episode = 0; episode < episodes; ++episode) {
    arena->begin(defaults(chosen.spec));
    rows.push_back(play(policy, noise, behavior, *arena));
  }
  std::string text = std::to_string(episodes) + " episodes, mean and 95 % confidence";
  text += line("reward", rows, 0) + line("length", rows, 1);
  for (int k = 0; k < behavior.metrics_size(); ++k) text += line(behavior.metrics(k).name(), rows, 2 + k);
  return text;
}

}  // namespace simulator
