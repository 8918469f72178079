#include "refusal.hpp"

namespace simulator {
namespace {

constexpr std::size_t HEAD = 400, TAIL = 200;  // bytes of a long text that are kept: gRPC gives a status 8 KiB

/// Returns a text with its middle left out if it is long: a client's name may be. UTF-8 is cut between characters.
std::string shortened(const std::string& text) {
  if (text.size() <= HEAD + TAIL) return text;
  const auto inside = [&text](std::size_t place) { return (static_cast<unsigned char>(text[place]) & 0xC0) == 0x80; };
  std::size_t head = HEAD, tail = text.size() - TAIL;
  while (head > 0 && inside(head)) --head;
  while (tail < text.size() && inside(tail)) ++tail;
  return text.substr(0, head) + " … " + text.substr(tail);
}

}  // namespace

Refusal::Refusal(grpc::StatusCode code, const std::string& text)
    : std::runtime_error(text), status_(code, shortened(text)) {}

Refusal invalid(const std::string& text) { return {grpc::StatusCode::INVALID_ARGUMENT, text}; }

}  // namespace simulator
