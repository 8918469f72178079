#include "authentication.hpp"

#include <grpcpp/security/auth_metadata_processor.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string_view>

#include "refusal.hpp"

namespace simulator {
namespace {

constexpr std::string_view HEALTH = "/grpc.health.v1.Health/";  // load balancers call it without a token
constexpr std::size_t SHORTEST = 16, LONGEST = 1000;            // characters of a token

std::string read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(text("cannot read ", path));
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Returns the token in a file. Errors never show it.
std::string read_token(const std::string& path) {
  std::string token = read(path);
  token.erase(token.find_last_not_of(" \r\n") + 1);
  const bool visible = std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < 127; });
  if (visible && token.size() >= SHORTEST && token.size() <= LONGEST) return token;
  throw std::runtime_error(
      text(path, " holds no token, expected one line of 16 to 1000 ASCII characters without spaces"));
}

/// Returns whether only programs of this machine can connect to an address.
bool is_local(const std::string& address) {
  return address.starts_with("127.") || address.starts_with("localhost:") || address.starts_with("[::1]:");
}

/// Compares in a time that depends on the length of `sent` only.
bool same(std::string_view sent, std::string_view wanted) {
  unsigned char different = sent.size() != wanted.size();
  for (std::size_t place = 0; place < sent.size(); ++place) {
    different |= static_cast<unsigned char>(sent[place] ^ wanted[place % wanted.size()]);
  }
  return different == 0;
}

/// Refuses every call but health without the token.
class TokenProcessor final : public grpc::AuthMetadataProcessor {
 public:
  explicit TokenProcessor(const std::string& token) : wanted_("Bearer " + token) {}

  bool IsBlocking() const override { return false; }

  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext*, OutputMetadata*, OutputMetadata*) override {
    const auto path = metadata.find(":path");
    if (path != metadata.end() && view(path->second).starts_with(HEALTH)) return grpc::Status::OK;
    const auto sent = metadata.find("authorization");
    if (metadata.count("authorization") == 1 && same(view(sent->second), wanted_)) return grpc::Status::OK;
    return {grpc::StatusCode::UNAUTHENTICATED,
            "this server requires a token; give the client its file with --token-file"};
  }

 private:
  static std::string_view view(const grpc::string_ref& string) { return {string.data(), string.size()}; }

  const std::string wanted_;
};

}  // namespace

std::shared_ptr<grpc::ServerCredentials> server_credentials(const std::string& address, const Files& files) {
  const bool encrypted = !files.certificate.empty();
  if (encrypted == files.key.empty()) throw std::runtime_error("TLS needs both --tls-cert and --tls-key");
  if (!is_local(address) && (!encrypted || files.token.empty())) {
    throw std::runtime_error(
        text(address, " can be reached from other machines, which needs --tls-cert, --tls-key and --token-file; give ",
             "them, or listen on 127.0.0.1"));
  }
  if (!encrypted && files.token.empty()) return grpc::InsecureServerCredentials();
  std::shared_ptr<grpc::ServerCredentials> credentials;
  if (encrypted) {
    grpc::SslServerCredentialsOptions options;
    options.pem_key_cert_pairs.push_back({read(files.key), read(files.certificate)});
    credentials = grpc::SslServerCredentials(options);
  } else {  // speaks to clients without TLS as InsecureServerCredentials does, which cannot look at a token
    credentials = grpc::experimental::LocalServerCredentials(LOCAL_TCP);
  }
  if (!files.token.empty()) credentials->SetAuthMetadataProcessor(std::make_shared<TokenProcessor>(read_token(files.token)));
  return credentials;
}

}  // namespace simulator
