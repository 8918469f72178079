/// Plays a policy with given observations, masks and noise, and prints what it does. Arguments: the policy's file, and
/// a file with decisions.

#include <iostream>

#include "policy.hpp"

using joybridge::Json;

int main(int, char** words) try {
  const joybridge::Policy policy(words[1]);
  joybridge::State state = policy.begin();
  std::cout.precision(9);
  for (const Json& decision : Json::read(words[2]).items) {
    joybridge::Sensors sensors;
    joybridge::Masks masks;
    for (std::size_t k = 0; k < decision["sensors"].items.size(); ++k) {
      for (const Json& value : decision["sensors"].items[k].items) {
        sensors[decision["sensors"].names[k]].push_back(float(value.number));
      }
    }
    for (std::size_t k = 0; k < decision["masks"].items.size(); ++k) {
      for (const Json& value : decision["masks"].items[k].items) {
        masks[decision["masks"].names[k]].push_back(value.number == 1);
      }
    }
    if (decision["waits"].number == 1) {
      policy.watch(sensors, state);
      continue;
    }
    auto uniform = decision["uniform"].items.begin(), normal = decision["normal"].items.begin();
    const joybridge::Noise noise{[&] { return (uniform++)->number; }, [&] { return (normal++)->number; }};
    const joybridge::Action action = policy.act(sensors, state, noise, masks);
    if (decision["ends"].number == 1) state = policy.begin();
    for (const float value : action.axes) std::cout << value << ' ';
    for (const int choice : action.choices) std::cout << choice << ' ';
    std::cout << '\n';
  }
} catch (const std::exception& error) {
  std::cerr << error.what() << std::endl;
  return 1;
}
