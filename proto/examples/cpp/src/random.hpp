/// Random numbers per arena: the n-th number of an arena is a pure function of the seed, the arena and n.
#pragma once

#include <array>
#include <cstdint>

namespace simulator {

/// Returns 64 random bits by Philox 4x32-10, a counter-based generator (Salmon et al., "Parallel random numbers: as
/// easy as 1, 2, 3", 2011). The seed is its key, the arena and n are its counter, so no two streams overlap.
constexpr std::uint64_t philox(std::uint64_t seed, std::uint64_t arena, std::uint64_t n) {
  const auto low = [](std::uint64_t bits) { return static_cast<std::uint32_t>(bits); };
  const auto high = [](std::uint64_t bits) { return static_cast<std::uint32_t>(bits >> 32); };
  std::array<std::uint32_t, 4> counter = {low(n), high(n), low(arena), high(arena)};
  std::uint32_t key[2] = {low(seed), high(seed)};
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t left = std::uint64_t{0xD2511F53} * counter[0];
    const std::uint64_t right = std::uint64_t{0xCD9E8D57} * counter[2];
    counter = {high(right) ^ counter[1] ^ key[0], low(right), high(left) ^ counter[3] ^ key[1], low(left)};
    key[0] += 0x9E3779B9;
    key[1] += 0xBB67AE85;
  }
  return std::uint64_t{counter[1]} << 32 | counter[0];
}
static_assert(philox(0, 0, 0) == 0xE169C58D6627E8D5, "the answer that is known from the paper's own code");

/// A stream of random numbers. These three integers are its whole state.
struct Random {
  std::uint64_t seed = 0, arena = 0, drawn = 0;

  /// Draws from [low, high).
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(philox(seed, arena, drawn++) >> 11) * 0x1p-53);
  }
};

}  // namespace simulator
