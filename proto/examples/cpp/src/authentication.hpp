/// Who may call the server: TLS, the token, and the addresses that need both. See SECURITY in bridge.proto.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

namespace simulator {

/// Paths of the command line; empty: not given.
struct Files {
  std::string certificate, key, token;
};

/// Returns the credentials of a server, which refuse every call but health without the token if there is one.
///
/// Throws std::runtime_error if a file cannot be used, or if other machines can reach the address without them.
std::shared_ptr<grpc::ServerCredentials> server_credentials(const std::string& address, const Files& files);

}  // namespace simulator
