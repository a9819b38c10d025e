// Sends a ball that wanders about in front of the arm, at 100 Hz. On Debian it needs cppzmq-dev.
//   g++ -std=c++17 perception.cpp -lzmq -o perception && ./perception
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>
#include <zmq.hpp>

int main(int count, char** arguments) {
  const std::string address = count > 1 ? arguments[1] : "tcp://127.0.0.1:5701";
  const std::string source = count > 2 ? arguments[2] : "camera";
  zmq::context_t context;
  zmq::socket_t publisher(context, zmq::socket_type::pub);
  publisher.set(zmq::sockopt::immediate, true);  // keep nothing for a monitor that is not there
  publisher.connect(address);
  auto tick = std::chrono::steady_clock::now();  // CLOCK_MONOTONIC on Linux
  for (long sequence = 1;; ++sequence) {
    const double stamp = std::chrono::duration<double>(tick.time_since_epoch()).count();  // [s]
    char text[512];
    const int size = std::snprintf(
        text, sizeof text,
        R"({"type": "obstacles", "source": "%s", "seq": %ld, "stamp": %.9f, "snapshot": true, )"
        R"("ids": ["ball"], "position": [[%.6f, -0.3, 0.5]], "velocity": [[%.6f, 0, 0]], )"
        R"("radius": 0.1})",
        source.c_str(), sequence, stamp, 3.0 + 0.5 * std::cos(0.4 * stamp),
        -0.2 * std::sin(0.4 * stamp));
    if (size < 0 || size >= int(sizeof text)) return 1;
    publisher.send(zmq::buffer(text, size), zmq::send_flags::none);
    std::this_thread::sleep_until(tick += std::chrono::milliseconds(10));
  }
}
