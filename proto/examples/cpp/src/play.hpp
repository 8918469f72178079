/// The arenas of a session, and what each request does to them.
#pragma once

#include "settings.hpp"
#include "tensors.hpp"

namespace simulator {

/// A session after its Start. Everything throws a Refusal for a request whose content is wrong.
class Play {
 public:
  Play(const Chosen& chosen, const pb::Start& start);
  Play(const Play&) = delete;  // parts of it refer to others

  const pb::GameSpec& spec() const { return chosen_.spec; }
  const std::string& name() const { return chosen_.spec.name(); }
  std::uint64_t steps() const { return steps_; }  // decisions so far

  /// Returns the present observations, with zero rewards and no ends.
  pb::Step observe();

  /// Advances every arena by one decision; an episode that ends is followed by the next one in the same step.
  pb::Step act(const pb::Act& act);

  /// Begins new episodes everywhere; with a seed, as a new session with that seed would.
  pb::Step reset(const pb::Reset& reset);

  /// Returns the state of all arenas.
  pb::Snapshot save() const;

 private:
  void set(const google::protobuf::Map<std::string, double>& parameters);
  void open(std::uint64_t seed);
  pb::Step finish(const std::vector<TimeStep>& results);
  pb::Ended end_episodes(const std::vector<std::int32_t>& lanes, const std::vector<TimeStep>& results);
  google::protobuf::RepeatedPtrField<pb::Tensor> observations(const std::vector<Arena*>& arenas) const;
  std::vector<Masks> masks() const;
  void check_draw(const pb::Act& act) const;
  pb::Tensor picture(std::uint32_t arena) const;
  void restore(const pb::Snapshot& snapshot);

  const Chosen chosen_;
  const pb::Behavior& behavior_;  // the only one
  const std::uint32_t lanes_;       // one per arena
  const std::uint32_t first_arena_;
  Parameters parameters_;  // as they are now
  std::string origin_;     // the fields of Start as text; part of every snapshot
  std::vector<std::unique_ptr<Arena>> arenas_;
  std::uint64_t steps_ = 0;
};

}  // namespace simulator
