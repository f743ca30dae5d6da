#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/render/plot.h"

namespace camber::detail {

/// Text as HTML.
std::string escape(const std::string& text);

/// A dash where it is not finite.
std::string number(double value, int decimals);

/// "1.23 &plusmn; 0.04": a value with its standard deviation, where one is stated.
std::string with_margin(double value, double sigma, int decimals);

std::string status_cell(Status status, const std::string& reason);

/// A row of a table; a cell that begins with "<td" stands as it is.
std::string row(const std::vector<std::string>& cells);

std::string table(const std::vector<std::string>& heads, const std::string& rows);

/// A JSON value as rows of a table of options or metrics; nested objects become dotted names, long
/// arrays are left out.
void flatten(const nlohmann::json& value, const std::string& name, std::string* rows);

/// Content behind a summary to click, or as it is.
std::string folded(const std::string& content, const std::string& summary, bool fold);

/// A plot twice: as wide as the page, and with larger words for narrow screens.
/// @param height  pixels of a panel of the wide one.
std::string plot_figure(const PlotSheet& sheet, int height = 230);

/// The page up to its heading.
std::string page_head(const std::string& title);

}  // namespace camber::detail
