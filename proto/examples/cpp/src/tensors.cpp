#include "tensors.hpp"

#include <bit>
#include <cstring>

namespace simulator {
namespace {

static_assert(std::endian::native == std::endian::little,
              "tensors are little-endian; swap their bytes on this machine");

/// Returns a dtype and a shape as they are read: "FLOAT32 [64, 2]".
template <typename Sizes>
std::string written(pb::Dtype dtype, const Sizes& shape) {
  std::vector<std::string> sizes;
  for (const auto size : shape) sizes.push_back(text(size));
  return text(pb::Dtype_IsValid(dtype) ? pb::Dtype_Name(dtype) : text("dtype ", int(dtype)), " [", list(sizes), "]");
}

/// Returns the numbers of a tensor, [rows, columns], after checking that it is what `field` must hold. Without columns
/// it must be absent, which is a null pointer.
template <typename T>
std::vector<T> unpack(const pb::Tensor* tensor, std::size_t rows, int columns, const std::string& field) {
  const pb::Dtype dtype = std::is_same_v<T, float> ? pb::DTYPE_FLOAT32 : pb::DTYPE_INT32;
  const std::string wanted = columns == 0 ? "none" : written(dtype, std::vector{rows, std::size_t(columns)});
  std::vector<T> values(rows * columns);
  if (tensor == nullptr && columns == 0) return values;
  const std::string came = tensor == nullptr ? "absent" : written(tensor->dtype(), tensor->shape());
  if (came != wanted) throw invalid(text(field, " is ", came, ", expected ", wanted));
  const std::size_t bytes = values.size() * sizeof(T);
  if (tensor->data().size() != bytes) {
    throw invalid(text(field, " has ", tensor->data().size(), " bytes of data, expected ", bytes, " for ", wanted));
  }
  std::memcpy(values.data(), tensor->data().data(), bytes);
  return values;
}

}  // namespace

Action Actions::of(std::size_t lane, std::size_t lanes) const {
  const std::size_t axis_count = axes.size() / lanes, branch_count = choices.size() / lanes;
  return {std::span(axes).subspan(lane * axis_count, axis_count),
          std::span(choices).subspan(lane * branch_count, branch_count)};
}

Actions unpack(const pb::BehaviorAct& act, const pb::Behavior& behavior, const std::vector<Masks>& masks) {
  const auto& axes = behavior.device().axes();
  const auto& branches = behavior.device().branches();
  const std::size_t lanes = masks.size();
  const auto* values = act.has_axes() ? &act.axes() : nullptr;
  const auto* indices = act.has_choices() ? &act.choices() : nullptr;
  const std::string in_axes = behavior.name() + ".axes", in_choices = behavior.name() + ".choices";
  Actions actions = {unpack<float>(values, lanes, axes.size(), in_axes),
                     unpack<std::int32_t>(indices, lanes, branches.size(), in_choices)};
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    const Action action = actions.of(lane, lanes);
    for (int index = 0; index < axes.size(); ++index) {
      const pb::Axis& axis = axes[index];
      const float value = action.axes[index];
      if (!(value >= axis.low() && value <= axis.high())) {  // also true for NaN
        throw invalid(text(in_axes, ": axis '", axis.name(), "' got ", value, " in lane ", lane, ", expected ",
                           axis.low(), "..", axis.high()));
      }
    }
    for (int index = 0; index < branches.size(); ++index) {
      const pb::Branch& branch = branches[index];
      const std::int32_t choice = action.choices[index];
      if (choice < 0 || choice >= branch.choices_size()) {
        throw invalid(text(in_choices, ": branch '", branch.name(), "' got ", choice, " in lane ", lane,
                           ", expected 0..", branch.choices_size() - 1));
      }
      if (!masks[lane][index][choice]) {
        throw invalid(text(in_choices, ": branch '", branch.name(), "' got '", branch.choices(choice), "' in lane ",
                           lane, ", which its mask forbids in this step"));
      }
    }
  }
  return actions;
}

}  // namespace simulator
