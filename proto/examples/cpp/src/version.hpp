/// Product version and contract revision of this server; see VERSIONS in bridge.proto.
#pragma once

#include "joybridge/v1/bridge.pb.h"

namespace simulator {

namespace pb = joybridge::v1;

/// Returns the version that this server states in its responses.
pb::Version own_version();

/// Throws a Refusal if a client needs a newer revision than this server has. A client that states none is served.
void check_version(const pb::Version& client);

}  // namespace simulator
