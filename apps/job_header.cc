#include "job_header.h"

#include "base/json_text.h"

namespace raylift {

using Json = nlohmann::ordered_json;

std::string JobHeader(Json options, size_t tasks, std::initializer_list<const char*> needless,
                      const Json& inputs) {
  Json header = {{"command", options["command"]},
                 {"raylift_version", options["raylift_version"]},
                 {"tasks", tasks}};
  for (const char* name : {"command", "raylift_version", "threads", "quiet", "config", "resume",
                           "overwrite", "shard", "out"}) {
    options.erase(name);
  }
  for (const char* name : needless) options.erase(name);
  header["options"] = std::move(options);
  header["inputs"] = inputs;
  return JsonText(header);
}

std::string OptionsOfResults(const std::string& options_json) {
  Json options = Json::parse(options_json);
  for (const char* name : {"resume", "overwrite", "shard"}) options.erase(name);
  return JsonText(options, 2) + '\n';
}

}  // namespace raylift
