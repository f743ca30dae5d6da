#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/scale/scale_evidence.h"

namespace camber {

/// `evidence` of run.json; numbers that are not finite become null.
nlohmann::json to_json(const std::vector<ScaleEvidence>& evidence);

/// A file of evidence, of a run with an answer or without one, atomically.
/// @param evidence  as to_json() has it.
/// @param reason    why there is no answer; empty: there is one.
/// @throws OutputError
void write_evidence(const nlohmann::json& evidence, const std::string& reason,
                    const std::filesystem::path& path);

}  // namespace camber
