/// Numbers <-> Tensor: all conversions between arrays and messages.
#pragma once

#include <cmath>
#include <stdexcept>
#include <type_traits>

#include "game.hpp"
#include "refusal.hpp"

namespace simulator {

using Masks = std::vector<std::vector<bool>>;  // of one lane: which choices are allowed, per branch

/// The actions of all lanes.
struct Actions {
  std::vector<float> axes;            // [lanes, axes]
  std::vector<std::int32_t> choices;  // [lanes, branches]

  /// Returns the action of one of so many lanes.
  Action of(std::size_t lane, std::size_t lanes) const;
};

/// Returns the actions of the lanes that have these masks. Throws a Refusal naming the axis, branch or field that is
/// not as the contract or the behavior requires.
Actions unpack(const pb::BehaviorAct& act, const pb::Behavior& behavior, const std::vector<Masks>& masks);

/// Returns numbers as a tensor: of FLOAT32, INT32 or, from bool, BOOL. Throws std::logic_error for too few or many of
/// them and for NaN, which only a wrong game sends.
template <typename T>
pb::Tensor pack(const std::vector<std::uint32_t>& shape, const std::vector<T>& values) {
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, std::int32_t> || std::is_same_v<T, bool>);
  pb::Tensor tensor;
  std::size_t wanted = 1;
  for (const auto size : shape) {
    tensor.add_shape(size);
    wanted *= size;
  }
  if (values.size() != wanted) throw std::logic_error(text(values.size(), " numbers to be sent, expected ", wanted));
  if constexpr (std::is_same_v<T, bool>) {
    tensor.set_dtype(pb::DTYPE_BOOL);
    tensor.mutable_data()->assign(values.begin(), values.end());  // a byte each, 0 or 1
  } else {
    tensor.set_dtype(std::is_same_v<T, float> ? pb::DTYPE_FLOAT32 : pb::DTYPE_INT32);
    tensor.set_data(values.data(), values.size() * sizeof(T));
  }
  if constexpr (std::is_same_v<T, float>) {
    for (const float value : values) {
      if (!std::isfinite(value)) throw std::logic_error(text("a number to be sent is ", value));
    }
  }
  return tensor;
}

}  // namespace simulator
