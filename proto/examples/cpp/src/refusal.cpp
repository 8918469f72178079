#include "refusal.hpp"

#include <google/protobuf/unknown_field_set.h>

#include <vector>

namespace simulator {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

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

/// Returns the path of the first unknown field of a message, or nothing. Where protobuf finds another type on the
/// wire than the contract has, it counts the field as unknown, too.
std::string unknown_field(const Message& message, const std::string& path) {
  const auto* reflection = message.GetReflection();
  const auto& unknown = reflection->GetUnknownFields(message);
  if (!unknown.empty()) return text(path, ": field ", unknown.field(0).number());
  std::vector<const FieldDescriptor*> fields;
  reflection->ListFields(message, &fields);
  for (const auto* field : fields) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_map()) continue;
    const std::string inner = path + "." + field->name();
    const int count = field->is_repeated() ? reflection->FieldSize(message, field) : 1;
    for (int index = 0; index < count; ++index) {
      const Message& part = field->is_repeated() ? reflection->GetRepeatedMessage(message, field, index)
                                                 : reflection->GetMessage(message, field);
      if (std::string found = unknown_field(part, inner); !found.empty()) return found;
    }
  }
  return "";
}

}  // namespace

Refusal::Refusal(grpc::StatusCode code, const std::string& text)
    : std::runtime_error(text), status_(code, shortened(text)) {}

Refusal invalid(const std::string& text) { return {grpc::StatusCode::INVALID_ARGUMENT, text}; }

void refuse_unknown(const Message& request) {
  if (const std::string found = unknown_field(request, request.GetDescriptor()->name()); !found.empty()) {
    throw invalid(found + " is unknown to this server or of another type; send what its bridge.proto has");
  }
}

}  // namespace simulator
