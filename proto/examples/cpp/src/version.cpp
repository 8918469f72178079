#include "version.hpp"

#include "refusal.hpp"

namespace simulator {
namespace {

constexpr const char* PRODUCT = "paddle 0.1.0";
constexpr std::uint32_t REVISION = 2;  // of bridge.proto

}  // namespace

pb::Version own_version() {
  pb::Version version;
  version.set_product(PRODUCT);
  version.set_revision(REVISION);
  return version;
}

void check_version(const pb::Version& client) {
  if (client.revision() <= REVISION) return;
  const std::string product = client.product().empty() ? "unnamed" : client.product();
  throw Refusal(grpc::StatusCode::FAILED_PRECONDITION,
                text("the client (", product, ") needs contract revision ", client.revision(), ", the simulator (",
                     PRODUCT, ") has revision ", REVISION, "; update the simulator, or use a client of its version"));
}

}  // namespace simulator
