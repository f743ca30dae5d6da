#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/evaluate/metrics.h"

namespace camber {

/// One scene's results compared with its truth.
struct EvaluatedScene {
  std::string scene;              ///< name of the scene
  std::string method;             ///< "flat", "coplanar", "joint", ...
  std::string detections_source;  ///< "network", "truth_boxes", ..., or empty
  SceneMetrics metrics;
  std::string preset{};       ///< "default", "paper", or empty
  std::string paper_terms{};  ///< of preset "paper": "meant", "printed"; otherwise empty
  bool metric = true;         ///< false: the result is up to scale, its errors are no metres
};

/// A subset of vehicles by scene, frame and id; -1 stands for all.
struct SubsetEntry {
  std::string scene;
  int frame = -1, vehicle = -1;
  int line = 0;  ///< of the file, from 1
};

/// Reads a subset: one "scene [frame [truth vehicle id]]" a line, '#' starts a comment.
/// @throws InputError "file: line: found, expected".
std::vector<SubsetEntry> read_subset(const std::filesystem::path& path);

/// Numbers over a set of vehicles; NaN where the set is empty.
struct ErrorSummary {
  int count = 0;  ///< values that entered
  double mean = 0.0, deviation = 0.0, median = 0.0, p90 = 0.0;
};
ErrorSummary summarise(std::vector<double> values);

/// One row of the paper's table.
struct LocalisationRow {
  std::string name;               ///< "all", "<= 15 m", "> 15 m", "<= 30 m", "> 30 m", "subset"
  int matched = 0;                ///< detections matched to counted vehicles
  int unanswered = 0;             ///< of these, those without an answer
  ErrorSummary center;            ///< m, 3D localisation error
  ErrorSummary height;            ///< m, absolute height error of the plane
  ErrorSummary normal;            ///< rad
  ErrorSummary yaw;               ///< rad, absolute
  ErrorSummary keypoint;          ///< m, 3D
  double center_within_95 = 0.0;  ///< share of the centres inside the stated ellipsoid
  double height_within_95 = 0.0;  ///< share of the heights inside the stated interval
};

/// The method with what distinguishes it from others of its name: "joint", "joint (paper)",
/// "joint (paper printed)".
std::string method_label(const std::string& method, const std::string& preset,
                         const std::string& paper_terms);

/// The tables of one method (with its preset and terms) over all its scenes.
struct MethodTables {
  std::string method, preset, paper_terms;
  std::vector<std::string> detections_sources;  ///< each once, in order of appearance
  bool metric = true;                           ///< false: a result among them is up to scale
  int scenes = 0, counted = 0, matched = 0, missed = 0, unanswered = 0;
  int without_covariance = 0, singular_covariance = 0;  ///< as in SceneMetrics
  double recall = 0.0;                                  ///< answered matches / counted
  double unanswered_share = 0.0;                        ///< of the matched
  std::vector<LocalisationRow> rows;
};

/// Tables by method, preset and terms, in order of appearance.
std::vector<MethodTables> make_tables(const std::vector<EvaluatedScene>& scenes,
                                      const std::vector<SubsetEntry>& subset = {});

/// Share of unanswered detections above which a table is marked.
inline constexpr double kMarkedUnansweredShare = 0.02;

std::string tables_text(const std::vector<MethodTables>& tables);      ///< for a terminal
std::string tables_markdown(const std::vector<MethodTables>& tables);  ///< GitHub tables
nlohmann::json tables_json(const std::vector<MethodTables>& tables);
/// One line a matched vehicle, with a header line.
std::string vehicles_csv(const std::vector<EvaluatedScene>& scenes);

}  // namespace camber
