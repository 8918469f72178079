/// Errors for clients: a gRPC status and a sentence with what was received, what was expected and what to do.
#pragma once

#include <grpcpp/support/status.h>

#include <charconv>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace simulator {

/// An error that ends its call, or its session, with a status. Every other exception is an error of the server.
class Refusal : public std::runtime_error {
 public:
  Refusal(grpc::StatusCode code, const std::string& text);

  const grpc::Status& status() const { return status_; }  // not `what()`, which ends where a client's name has a NUL

 private:
  grpc::Status status_;
};

/// Returns a Refusal with INVALID_ARGUMENT: the content of a message is wrong.
Refusal invalid(const std::string& text);

/// Returns its arguments written one after the other, floating-point numbers with as many digits as tell them apart.
template <typename... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream stream;
  const auto write = [&stream](const auto& part) {
    if constexpr (std::is_floating_point_v<std::decay_t<decltype(part)>>) {
      char digits[32];
      stream.write(digits, std::to_chars(digits, digits + sizeof digits, part).ptr - digits);
    } else {
      stream << part;
    }
  };
  (write(parts), ...);
  return stream.str();
}

/// Returns strings with commas between them, or "none".
template <typename Strings>
std::string list(const Strings& strings) {
  std::string joined;
  for (const std::string& string : strings) joined += (joined.empty() ? "" : ", ") + string;
  return joined.empty() ? "none" : joined;
}

}  // namespace simulator
