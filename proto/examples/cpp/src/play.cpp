#include "play.hpp"

#include <chrono>
#include <cstring>
#include <utility>

namespace simulator {
namespace {

constexpr int MOST_PICTURES = 64;  // of one Act

/// Returns how many arenas a session is to have. Throws a Refusal before anything is made for too many.
std::uint32_t checked_arenas(const pb::GameSpec& spec, std::uint32_t arenas) {
  if (arenas >= 1 && arenas <= spec.max_arenas()) return arenas;
  const auto code = arenas < 1 ? grpc::StatusCode::INVALID_ARGUMENT : grpc::StatusCode::RESOURCE_EXHAUSTED;
  throw Refusal(code, text(spec.name(), ": arenas is ", arenas, ", expected 1..", spec.max_arenas()));
}

/// Returns the fields of Start as text. A snapshot fits a session with the same text.
std::string origin(const Chosen& chosen, const Parameters& parameters, const pb::Start& start) {
  std::string how = chosen.spec.name();
  for (const auto& [name, choice] : chosen.options) how += text(" ", name, "=", choice);
  for (const auto& [name, value] : parameters) how += text(" ", name, "=", value);
  return how + text(" arenas=", start.arenas(), " first_arena=", start.first_arena(), " seed=", start.seed());
}

template <typename T>
void append(std::vector<T>& all, const std::vector<T>& more) {
  all.insert(all.end(), more.begin(), more.end());
}

}  // namespace

Play::Play(const Chosen& chosen, const pb::Start& start)
    : chosen_(chosen),
      behavior_(chosen_.spec.behaviors(0)),
      lanes_(checked_arenas(chosen.spec, start.arenas())),
      first_arena_(start.first_arena()),
      parameters_(defaults(chosen.spec)) {
  check_none(chosen.spec, start.distributions());
  set(start.parameters());
  origin_ = origin(chosen, parameters_, start);
  open(start.seed());
  if (start.has_snapshot()) restore(start.snapshot());
}

pb::Step Play::observe() {
  const TimeStep quiet = {std::vector<float>(behavior_.channels_size()), End::none, {}};
  return finish(std::vector<TimeStep>(lanes_, quiet));
}

pb::Step Play::act(const pb::Act& act) {
  if (act.behaviors_size() != 1) {
    throw invalid(text("act.behaviors has ", act.behaviors_size(), " entries, expected 1"));
  }
  const Actions actions = unpack(act.behaviors(0), behavior_, masks());
  check_draw(act);
  check_none(spec(), act.distributions());
  ++steps_;  // everything is checked; from here on the arenas change
  const auto begin = std::chrono::steady_clock::now();
  std::vector<TimeStep> results;
  for (std::uint32_t lane = 0; lane < lanes_; ++lane) results.push_back(arenas_[lane]->step(actions.of(lane, lanes_)));
  pb::Step step = finish(results);
  step.set_simulate_seconds(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  for (const auto arena : act.draw()) *step.add_pictures() = picture(arena);
  return step;
}

pb::Step Play::reset(const pb::Reset& reset) {
  check_none(spec(), reset.distributions());
  set(reset.parameters());
  if (reset.has_seed()) {
    open(reset.seed());
  } else {
    for (const auto& arena : arenas_) arena->begin(parameters_);
  }
  return observe();
}

pb::Snapshot Play::save() const {
  if (spec().snapshot_bytes_per_arena() == 0) {
    const std::string what = name() + " has no snapshots (snapshot_bytes_per_arena is 0); begin new episodes instead";
    throw Refusal(grpc::StatusCode::FAILED_PRECONDITION, what);
  }
  pb::Snapshot snapshot;
  auto& parts = *snapshot.mutable_parts();
  parts["origin"] = origin_;
  std::string& values = parts["parameters"];  // a Reset may have changed them since Start
  for (const auto& [_, value] : parameters_) values.append(reinterpret_cast<const char*>(&value), sizeof value);
  for (const auto& arena : arenas_) parts["arenas"] += arena->save();
  return snapshot;
}

void Play::restore(const pb::Snapshot& snapshot) {
  const pb::Snapshot present = save();
  std::map<std::string, std::string> parts(snapshot.parts().begin(), snapshot.parts().end());
  if (parts["origin"] != origin_) {
    throw invalid("snapshot is from a session with another Start; use the same: " + origin_);
  }
  for (const auto& [part, data] : present.parts()) {
    if (parts[part].size() != data.size()) {
      throw invalid(text("snapshot has ", parts[part].size(), " bytes in '", part, "', expected ", data.size()));
    }
  }
  if (parts.size() != present.parts().size()) throw invalid("snapshot has a part that is unknown to this server");
  const char* values = parts["parameters"].data();
  for (auto& [parameter, value] : parameters_) {
    std::memcpy(&value, std::exchange(values, values + sizeof value), sizeof value);
    checked(spec(), parameter, value);
  }
  const std::size_t each = parts["arenas"].size() / lanes_;
  for (std::uint32_t lane = 0; lane < lanes_; ++lane) {
    try {
      arenas_[lane]->restore(parts["arenas"].substr(lane * each, each));
    } catch (const std::invalid_argument& error) {
      throw invalid(text("snapshot: arena ", lane, ": ", error.what()));
    }
  }
}

/// Takes over the given parameters; the others keep their values.
void Play::set(const google::protobuf::Map<std::string, double>& parameters) {
  for (const auto& [parameter, value] : parameters) parameters_[parameter] = checked(spec(), parameter, value);
}

/// Makes the arenas of a seed and begins a first episode in each.
void Play::open(std::uint64_t seed) {
  arenas_.clear();
  for (std::uint64_t k = 0; k < lanes_; ++k) {  // the number of an arena may need more than 32 bits
    arenas_.push_back(chosen_.game.open(chosen_.options, seed, first_arena_ + k));
    arenas_.back()->begin(parameters_);
  }
}

/// Begins the next episode where one ended, and returns the step.
pb::Step Play::finish(const std::vector<TimeStep>& results) {
  std::vector<float> rewards;
  std::vector<bool> terminated, truncated;
  std::vector<std::int32_t> ended;
  for (std::uint32_t lane = 0; lane < lanes_; ++lane) {
    const TimeStep& result = results[lane];
    append(rewards, result.rewards);
    terminated.push_back(result.end == End::terminated);
    truncated.push_back(result.end == End::truncated);
    if (result.end != End::none) ended.push_back(static_cast<std::int32_t>(lane));
  }
  pb::Step step;
  pb::BehaviorStep& part = *step.add_behaviors();
  const std::uint32_t channels = behavior_.channels_size();
  *part.mutable_rewards() = pack({lanes_, channels}, rewards);
  *part.mutable_terminated() = pack({lanes_}, terminated);
  *part.mutable_truncated() = pack({lanes_}, truncated);
  if (!ended.empty()) *part.mutable_ended() = end_episodes(ended, results);
  std::vector<Arena*> all;
  for (const auto& arena : arenas_) all.push_back(arena.get());
  *part.mutable_observations() = observations(all);  // where an episode ended, these are of the next one
  const std::vector<Masks> allowed = masks();
  for (int branch = 0; branch < behavior_.device().branches_size(); ++branch) {
    std::vector<bool> column;
    for (const Masks& mask : allowed) append(column, mask[branch]);
    const std::uint32_t choices = behavior_.device().branches(branch).choices_size();
    *part.add_masks() = pack({lanes_, choices}, column);
  }
  return step;
}

/// Returns the ends of some lanes' episodes and begins the next ones.
pb::Ended Play::end_episodes(const std::vector<std::int32_t>& lanes, const std::vector<TimeStep>& results) {
  std::vector<Arena*> arenas;
  std::vector<float> values;
  for (const auto lane : lanes) {
    arenas.push_back(arenas_[lane].get());
    append(values, results[lane].metrics);
  }
  const std::uint32_t rows = lanes.size(), metrics = behavior_.metrics_size();
  pb::Ended ended;
  *ended.mutable_lanes() = pack({rows}, lanes);
  *ended.mutable_final_observations() = observations(arenas);
  if (metrics > 0) *ended.mutable_metrics() = pack({rows, metrics}, values);
  for (Arena* arena : arenas) arena->begin(parameters_);
  return ended;
}

/// Returns a tensor per sensor, with a row per arena.
google::protobuf::RepeatedPtrField<pb::Tensor> Play::observations(const std::vector<Arena*>& arenas) const {
  std::vector<std::vector<float>> columns(behavior_.sensors_size());
  for (const Arena* arena : arenas) {
    const auto sensed = arena->observe();
    for (std::size_t sensor = 0; sensor < columns.size(); ++sensor) append(columns[sensor], sensed.at(sensor));
  }
  google::protobuf::RepeatedPtrField<pb::Tensor> tensors;
  for (std::size_t sensor = 0; sensor < columns.size(); ++sensor) {
    std::vector<std::uint32_t> shape(1, arenas.size());
    for (const auto size : behavior_.sensors(sensor).shape()) shape.push_back(size);
    *tensors.Add() = pack(shape, columns[sensor]);
  }
  return tensors;
}

std::vector<Masks> Play::masks() const {
  std::vector<Masks> all;
  for (const auto& arena : arenas_) all.push_back(arena->masks());
  return all;
}

void Play::check_draw(const pb::Act& act) const {
  if (!act.draw().empty() && !spec().has_picture()) {
    throw Refusal(grpc::StatusCode::FAILED_PRECONDITION, name() + " cannot be drawn; leave act.draw empty");
  }
  const std::string wanted = text(", expected at most ", MOST_PICTURES, " of arenas 0..", lanes_ - 1);
  if (act.draw_size() > MOST_PICTURES) throw invalid(text("act.draw asks for ", act.draw_size(), " pictures", wanted));
  for (const auto arena : act.draw()) {
    if (arena >= lanes_) throw invalid(text("act.draw asks for arena ", arena, wanted));
  }
}

pb::Tensor Play::picture(std::uint32_t arena) const {
  const std::uint32_t height = spec().picture().height(), width = spec().picture().width();
  pb::Tensor tensor;
  tensor.set_dtype(pb::DTYPE_UINT8);
  for (const auto size : {height, width, 3U}) tensor.add_shape(size);
  tensor.set_data(arenas_[arena]->draw());
  return tensor;
}

}  // namespace simulator
