#pragma once

#include <string>
#include <vector>

#include "camber/core/status.h"

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

}  // namespace camber::detail
