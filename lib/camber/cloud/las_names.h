#pragma once

#include <string_view>

namespace camber {

/// The attribute of LAS records, under the name that it has in this library ("intensity",
/// "return_number", "gps_time", "withheld", ...), that an attribute's name stands for in any
/// program known: PDAL ("ReturnNumber", "returnnumber"), CloudCompare ("scalar_Return_Number"),
/// laspy, lidR; in any case, with and without blanks, '_' and '-'. Empty for other names.
std::string_view las_attribute(std::string_view name);

/// Name of a point's class by ASPRS LAS 1.4 R15, table 17: "ground" of 2; "reserved" and "user
/// defined" (from 64 on) of others.
std::string_view las_class_name(int number);

}  // namespace camber
