// A simulated arm in a ROS 2 graph, on Fast DDS alone, for `armguard drive demos/ros2.toml`:
//   g++ -std=c++17 ros2_arm.cpp -lfastrtps -lfastcdr -o ros2_arm && ./ros2_arm DOMAIN
// It swings its first joint at the speed of /armguard/speed_override, and stands without one. From
// the first trajectory on it follows these alone, as cubics. /people shows a ball. It reads lines
// (`ball X Y Z`, `acknowledge`, `mute`, `unmute`, `garbage`), and prints what it hears and where it is, with [s] of
// the monotonic clock. On the loopback alone.
#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <atomic>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <mutex>
#include <sstream>
#include <thread>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using eprosima::fastcdr::Cdr;
using Doubles = std::vector<double>;

// Messages: `each` goes through their fields; `raw`, if there is any, is sent in place of them.
struct Message {
  int32_t sec = 0;
  uint32_t nanosec = 0;
  std::string frame;
  std::vector<uint8_t> raw;
  template <class F> void header(F& f) { f(sec), f(nanosec), f(frame); }
};
struct JointState : Message {
  std::vector<std::string> name;
  Doubles q, v, effort;
  template <class F> void each(F& f) { header(f), f(name), f(q), f(v), f(effort); }
};
struct PoseArray : Message {
  uint32_t count = 1;
  double x = 3, y = 0, z = 0.5, turn[4] = {0, 0, 0, 1};
  template <class F> void each(F& f) {
    header(f), f(count), f(x), f(y), f(z);
    for (auto& one : turn) f(one);
  }
};
struct Float64 : Message {
  double data = 0;
  template <class F> void each(F& f) { f(data); }
};
struct Bool : Message {
  bool data = true;
  template <class F> void each(F& f) { f(data); }
};
struct Diagnostics : Message {  // no more than the beginning
  uint32_t count = 0;
  uint8_t level = 0;
  std::string name, text;
  template <class F> void each(F& f) { header(f), f(count), f(level), f(name), f(text); }
};
struct Point {
  Doubles q, v, a, effort;
  int32_t sec = 0;
  uint32_t nanosec = 0;
};
struct Trajectory : Message {
  std::vector<std::string> name;
  std::vector<Point> points;
  template <class F> void each(F& f) {
    uint32_t count = 0;
    header(f), f(name), f(count), points.resize(count);
    for (auto& one : points) f(one.q), f(one.v), f(one.a), f(one.effort), f(one.sec), f(one.nanosec);
  }
};

template <class T> struct Type : TopicDataType {
  explicit Type(const char* name) { setName(name), m_typeSize = 1 << 17; }
  bool serialize(void* data, SerializedPayload_t* out) override {
    auto& value = *static_cast<T*>(data);
    eprosima::fastcdr::FastBuffer buffer((char*)out->data, out->max_size);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    auto write = [&cdr](auto& field) { cdr << field; };
    if (value.raw.empty()) value.each(write);
    cdr.serializeArray(value.raw.data(), value.raw.size());
    out->encapsulation = CDR_LE, out->length = cdr.getSerializedDataLength();
    return true;
  }
  bool deserialize(SerializedPayload_t* in, void* data) override {
    eprosima::fastcdr::FastBuffer buffer((char*)in->data, in->length);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    auto read = [&cdr](auto& field) { cdr >> field; };
    static_cast<T*>(data)->each(read);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return 1u << 17; };
  }
  void* createData() override { return new T; }
  void deleteData(void* data) override { delete static_cast<T*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

double read_clock(clockid_t clock, Message* stamped = nullptr) {
  timespec time;
  clock_gettime(clock, &time);
  if (stamped) stamped->sec = time.tv_sec, stamped->nanosec = time.tv_nsec;
  return time.tv_sec + 1e-9 * time.tv_nsec;
}

template <class T> bool take(DataReader* reader, T& value) {
  SampleInfo info;
  while (reader->take_next_sample(&value, &info) == ReturnCode_t::RETCODE_OK)
    if (info.valid_data) return true;
  return false;
}

int main(int, char** arguments) {
  const int domain = std::atoi(arguments[1]);
  auto qos = PARTICIPANT_QOS_DEFAULT;
  auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  transport->interfaceWhiteList = {"127.0.0.1"};
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(transport);
  for (int index = 0; index < 10; ++index) {
    Locator_t peer(7410 + 250 * domain + 2 * index);
    IPLocator::setIPv4(peer, 127, 0, 0, 1);
    qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  }
  auto participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
  auto publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  auto topic = [&](const char* name, TypeSupport type) {
    type.register_type(participant);
    return participant->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
  };
  auto say = [&](const char* name, TypeSupport type) {
    return publisher->create_datawriter(topic(name, type), DATAWRITER_QOS_DEFAULT);
  };
  auto hear = [&](const char* name, TypeSupport type) {
    auto reliable = DATAREADER_QOS_DEFAULT;
    reliable.reliability().kind = RELIABLE_RELIABILITY_QOS;
    return subscriber->create_datareader(topic(name, type), reliable);
  };
#define TYPE(T, name) TypeSupport(new Type<T>(name))
  auto states = say("rt/joint_states", TYPE(JointState, "sensor_msgs::msg::dds_::JointState_"));
  auto people = say("rt/people", TYPE(PoseArray, "geometry_msgs::msg::dds_::PoseArray_"));
  auto acknowledge = say("rt/armguard/acknowledge", TYPE(Bool, "std_msgs::msg::dds_::Bool_"));
  auto speeds = hear("rt/armguard/speed_override", TYPE(Float64, "std_msgs::msg::dds_::Float64_"));
  auto reports = hear("rt/diagnostics", TYPE(Diagnostics, "diagnostic_msgs::msg::dds_::DiagnosticArray_"));
  auto motions = hear("rt/joint_trajectory_controller/joint_trajectory",
                      TYPE(Trajectory, "trajectory_msgs::msg::dds_::JointTrajectory_"));

  JointState state;
  for (int joint = 1; joint <= 7; ++joint) state.name.push_back("panda_joint" + std::to_string(joint));
  PoseArray ball;
  std::mutex guard;
  std::atomic<bool> muted{false}, garbage{false};
  std::thread([&] {
    for (std::string line, word; std::getline(std::cin, line);) {
      std::istringstream words(line);
      words >> word;
      std::lock_guard<std::mutex> lock(guard);
      if (word == "ball") words >> ball.x >> ball.y >> ball.z;
      if (Bool yes; word == "acknowledge") acknowledge->write(&yes);
      if (word == "mute" || word == "unmute") muted = word == "mute";
      if (word == "garbage") garbage = true;
    }
    std::_Exit(0);  // who started it has ended
  }).detach();

  Doubles q = {0, -0.785, 0, -2.356, 0, 1.571, 0.785}, v(7, 0.0);
  Trajectory motion;
  Point before;
  double phase = 0, scale = 0, asked = -1, heard = 0, begun = 0, taken = 0;
  std::string level;
  long tick = 0;
  for (auto next = std::chrono::steady_clock::now();; std::this_thread::sleep_until(next)) {
    next += std::chrono::milliseconds(2);
    const double time = read_clock(CLOCK_MONOTONIC), date = read_clock(CLOCK_REALTIME);
    for (Float64 speed; take(speeds, speed); asked = speed.data, heard = time)
      if (speed.data != asked) std::printf("speed %g %.6f\n", speed.data, time);
    for (Diagnostics one; take(reports, one);)
      if (one.text != level) std::printf("level %d %s\n", one.level, (level = one.text).c_str());
    while (take(motions, motion)) {
      std::printf("trajectory %zu %.6f\n", motion.points.size(), time);
      begun = motion.sec ? motion.sec + 1e-9 * motion.nanosec : date;
      before.q = q, before.v = v, taken = date;
    }
    if (motion.points.empty()) {
      // A ramp of 0.1 s; and nothing moves unless a number is younger than two periods.
      const double goal = time - heard < 0.05 ? std::max(asked, 0.0) : 0.0;
      scale += std::min(std::max(goal - scale, -0.02), 0.02), phase += scale * 0.002;
      q[0] = 0.4 * std::sin(phase), v[0] = 0.4 * scale * std::cos(phase);
    }
    const Point* last = &before;
    double t0 = taken;
    for (auto& point : motion.points) {
      const double t1 = begun + point.sec + 1e-9 * point.nanosec, h = t1 - t0;
      const double u = std::min((date - t0) / h, 1.0);
      for (size_t j = 0; j < q.size() && h > 0; ++j) {
        const double a = h * last->v[j], b = h * point.v[j], way = point.q[j] - last->q[j];
        q[j] = last->q[j] + u * (a + u * (3 * way - 2 * a - b + u * (a + b - 2 * way)));
        v[j] = (a + u * (2 * (3 * way - 2 * a - b) + 3 * u * (a + b - 2 * way))) / h;
      }
      if (date < t1) break;
      t0 = t1, last = &point;
    }
    std::lock_guard<std::mutex> lock(guard);
    read_clock(CLOCK_REALTIME, &state), read_clock(CLOCK_REALTIME, &ball);
    state.q = q, state.v = v;
    if (!muted) states->write(&state);
    if (!muted && ++tick % 10 == 0) people->write(&ball);
    std::printf("at %.6f %.6f %.6f\n", time, q[0], v[0]), std::fflush(stdout);
    if (!garbage.exchange(false)) continue;
    JointState wrong;
    auto send = [&](auto change) { wrong = state, change(), states->write(&wrong); };
    send([&] { wrong.v.pop_back(); });
    send([&] { wrong.name.pop_back(); });
    send([&] { wrong.name.assign(7, "elbow"); });
    send([&] { wrong.name[2] = "\xff\xfe"; });
    send([&] { wrong.q[3] = NAN; });
    send([&] { wrong.v[0] = INFINITY; });
    send([&] { wrong.sec = wrong.nanosec = 0; });
    for (size_t length : {1, 7, 40, 4000}) send([&] { wrong.raw.assign(length, 0xff); });
    auto nowhere = ball;
    nowhere.y = NAN, people->write(&nowhere);
    nowhere.raw.assign(33, 0xff), people->write(&nowhere);
  }
}
