"""Columns as loggers, apps and programs name them, the truth first: how many are read rightly, or refused with a way out that works.

    python benchmarks/columns.py [pattern of names]

2,006 inputs: 200 headers that jaxcal's names were written with, and 803 that were written afterwards, in ten parts, each of a sensor turned
by hand and of one at rest. The signals and the text share no code with the reader. A refusal counts as rightly refused if the file holds no sensor, or if the
options that it names, typed as they stand, give the truth (the rate, and what the file cannot say, are known to whoever typed).
"""

# ruff: noqa: E501, E731, UP031, RUF100

import ast
import collections
import datetime
import pathlib
import re
import sys
import tempfile

import numpy as np

import jaxcal
from jaxcal.io._columns import pairs

DEG, G = np.pi / 180, 9.80665
RATE, N = 100.0, 600
T = np.arange(N) / RATE
UNIT = {
    "r": 1.0,
    "d": DEG,
    "md": DEG / 1e3,
    "mr": 1e-3,
    "cd": DEG / 100,
    "m": 1.0,
    "g": G,
    "mg": G / 1e3,
    "uT": 1e-6,
    "G": 1e-4,
    "mG": 1e-7,
    "nT": 1e-9,
    "T": 1.0,
    "cm": 0.01,
    "rel": 48e-6,
}


def motion(kind):
    rng = np.random.default_rng(len(kind))
    w = np.zeros((N, 3))
    if kind == "hand":
        for _ in range(10):
            mid, width = rng.uniform(0, T[-1]), rng.uniform(0.3, 0.9)
            w += 1.5 * rng.normal(size=3) * np.exp(-(((T[:, None] - mid) / width) ** 2))
    C = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    C *= np.sign(np.linalg.det(C))
    a, m = np.empty((N, 3)), np.empty((N, 3))
    north = 48e-6 * np.array([np.cos(1.1), 0, -np.sin(1.1)])
    for k in range(N):
        a[k], m[k] = C.T @ [0, 0, G], C.T @ north
        th = np.linalg.norm(w[k]) / RATE
        if th > 0:
            x, y, z = w[k] / np.linalg.norm(w[k])
            X = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            C = C @ (np.eye(3) + np.sin(th) * X + (1 - np.cos(th)) * X @ X)
    free = 0.3 * rng.normal(size=(N, 3)) if kind == "hand" else 0.02 * rng.normal(size=(N, 3))
    first = {
        "w": w + 0.01 * rng.normal(size=3) + 0.002 * rng.normal(size=(N, 3)),
        "a": a * 1.01 + 0.02 * rng.normal(size=(N, 3)) + (free if kind == "hand" else 0),
        "m": m + 1e-5 * rng.normal(size=3) + 2e-7 * rng.normal(size=(N, 3)),
        "f": free,
        "v": a,
    }
    # a second device beside it, whose readings must not be mixed with those of the first
    return first | {name.upper(): first[name][:, [1, 2, 0]] + offset for name, offset in (("w", 0.003), ("a", 0.0), ("m", 3e-6))}


MOTION = {"hand": motion("hand"), "still": motion("still")}
DAY = datetime.datetime(2023, 5, 1, 11, 59, 58)
MOM = [DAY + datetime.timedelta(seconds=float(t)) for t in T]
E0 = 1700000000
COUNT = {"a": G / 16384, "w": DEG / 131, "m": 0.15e-6, "A": G / 16384, "W": DEG / 131}
LOOK = np.column_stack([np.sin(T), np.cos(2 * T), np.full(N, 3.0)])


def fields(token, sig):
    rng = np.random.default_rng(3)
    kind, _, unit = token.partition(":")
    one = lambda form: [[form(t) for t in T]]
    simple = {
        "i": lambda: [[str(k) for k in range(N)]],
        "I": lambda: [[str(4000 + k) for k in range(N)]],
        "i256": lambda: [[str(k % 256) for k in range(N)]],
        "t": lambda: one(lambda t: f"{t:.3f}"),
        "tms": lambda: one(lambda t: f"{4321 + 1e3 * t:.0f}"),
        "tus": lambda: one(lambda t: f"{7e6 + 1e6 * t:.0f}"),
        "tms0": lambda: one(lambda t: f"{1e3 * t:.2f}"),
        "tns": lambda: one(lambda t: f"{5e9 + 1e9 * t:.0f}"),
        "Ts": lambda: one(lambda t: f"{E0 + t:.3f}"),
        "Tms": lambda: one(lambda t: f"{E0 * 1000 + round(1e3 * t)}"),
        "Tus": lambda: one(lambda t: f"{E0 * 10**6 + round(1e6 * t)}"),
        "Tns": lambda: one(lambda t: f"{E0 * 10**9 + round(1e9 * t)}"),
        "D": lambda: [[m.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] for m in MOM]],
        "C": lambda: [[m.strftime("%H:%M:%S.%f")[:-3] for m in MOM]],
        "D2": lambda: [[m.strftime("%Y-%m-%d") for m in MOM]],
        "Du": lambda: [[m.strftime("%m/%d/%Y") for m in MOM]],
        "week": lambda: [["2245"] * N],
        "tow": lambda: one(lambda t: f"{390884 + t:.3f}"),
        "sec": lambda: one(lambda t: str(E0 + int(t + 1e-9))),
        "nsec": lambda: one(lambda t: f"{round((t % 1) * 1e9) % 10**9}"),
        "q": lambda: [[f"{v:.5f}" for v in np.cos(0.3 * k + 0.05 * T)] for k in range(4)],
        "e": lambda: [[f"{v:.3f}" for v in 10 * k + 20 * np.sin(T * (k + 1))] for k in range(3)],
        "L": lambda: [
            [f"{48 + 1e-7 * k:.7f}" for k in range(N)],
            [f"{11 + 1e-7 * k:.7f}" for k in range(N)],
            [f"{500 + 0.001 * k:.3f}" for k in range(N)],
        ],
        "p": lambda: [[f"{1013 + 0.01 * (k % 9):.2f}" for k in range(N)]],
        "tmp": lambda: [[f"{25 + k / N:.2f}" for k in range(N)]],
        "z": lambda: [[""] * N],
        "k": lambda: [[str(int(v)) for v in rng.integers(0, 256, N)]],
        "kh": lambda: [[f"{int(v):02X}" for v in rng.integers(0, 256, N)]],
        "u": lambda: [[f"{v:.5f}" for v in one] for one in (LOOK / np.linalg.norm(LOOK, axis=1)[:, None]).T],
        "b": lambda: [[f"{v:.6f}" for v in 0.01 * (k + 1) + 0.002 * np.sin(0.2 * T * (k + 1))] for k in range(3)],
        "n3": lambda: [[f"{v:.4f}" for v in np.sin(T * (k + 1)) * (k + 1)] for k in range(3)],
    }
    if kind in simple and not unit:
        return simple[kind]()
    if kind == "s":
        return [[unit] * N]
    if kind == "n":  # a number
        return [[unit] * N]
    if kind in ("norm",):
        v = np.linalg.norm(sig["a"], axis=1) / UNIT[unit]
        return [[f"{x:.5g}" for x in v]]
    order = "xyz"
    if len(kind) == 4:
        kind, order = kind[0], kind[1:]
    values = np.round(sig[kind] / COUNT[kind]) if unit == "c" else sig[kind] / UNIT[unit] if unit != "i" else np.cumsum(sig[kind], 0) / RATE
    form = (lambda v: f"{v:.0f}") if unit == "c" else (lambda v: f"{v:.7g}")
    return [[form(v) for v in values[:, "xyz".index(x)]] for x in order]


# name, file, header, spec, want, options of the entry
CASES = []


def add(name, header, spec, want=None, file="log.csv", mark=",", refuse=None, **more):
    CASES.append(dict(name=name, header=header, spec=spec.split(), want=want, file=file, mark=mark, refuse=refuse, **more))


# fmt: off
# --- issue 44, columns
add("EuRoC truth with biases only", "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1]", "Tns n3 n3", refuse="no_sensor")
add("biases alone", "t,b_w_RS_S_x,b_w_RS_S_y,b_w_RS_S_z", "t n3", refuse="no_sensor")
add("EuRoC truth", "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]", "Tns n3 q n3 n3 n3", refuse="no_sensor")
add("attitudes", "time,roll,pitch,yaw", "t e", refuse="no_sensor")
add("attitudes in degrees", "Timestamp(ms),Roll(deg),Pitch(deg),Yaw(deg)", "tms e", refuse="no_sensor")
add("GPS rows", "time,latitude,longitude,altitude,speed,course,hdop", "Ts L p p p", refuse="no_sensor")
add("filter states", "t,pn,pe,pd,vn,ve,vd,bgx,bgy,bgz,bax,bay,baz", "t n3 n3 n3 n3", refuse="no_sensor")
add("filter states with std", "t,x_pos,y_pos,z_pos,gyro_bias_x,gyro_bias_y,gyro_bias_z,acc_bias_x,acc_bias_y,acc_bias_z", "t n3 n3 n3", refuse="no_sensor")
add("quaternions", "t,q0,q1,q2,q3", "t q", refuse="no_sensor")
LVM = "LabVIEW Measurement\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\nX_Columns\tOne\nTime_Pref\tAbsolute\nOperator\tlab\nDate\t2023/05/01\nTime\t11:59:58.0\n***End_of_Header***\t\n\t\nChannels\t3\t\t\t\nSamples\t600\t600\t600\t\nDate\t2023/05/01\t2023/05/01\t2023/05/01\t\nTime\t11:59:58.0\t11:59:58.0\t11:59:58.0\t\nY_Unit_Label\tg\tg\tg\t\nX_Dimension\tTime\tTime\tTime\t\nX0\t0.0E+0\t0.0E+0\t0.0E+0\t\nDelta_X\t0.01\t0.01\t0.01\t\n***End_of_Header***\t\t\t\t\nX_Value\t"
add("LVM of three channels in g", LVM + "Acceleration\tAcceleration_1\tAcceleration_2\tComment", "t a:g", file="log.lvm", mark="\t", suffix="\t")
add("LVM of named axes", LVM + "AccX\tAccY\tAccZ\tComment", "t a:g", file="log.lvm", mark="\t", suffix="\t")
add("LVM untitled", LVM + "Untitled\tUntitled 1\tUntitled 2\tComment", "t a:g", file="log.lvm", mark="\t", suffix="\t")
add("empty last field", "time;dev;ax;ay;az;gx;gy;gz;label", "t n:1 a:g w:d z", mark=";")
add("gyroRotation in rad/s", "timestamp,gyroRotationX,gyroRotationY,gyroRotationZ,accelerometerAccelerationX,accelerometerAccelerationY,accelerometerAccelerationZ", "Ts w:r a:g")
add("Counter only", "Counter,ax,ay,az,gx,gy,gz", "i a:g w:d")
add("Counter only Xsens", "Counter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z\tMat[1][1]", "i a:m w:r m:rel n:1", want="aw", mark="\t", file="log.txt")
add("increments", "t,dtheta_x,dtheta_y,dtheta_z,dv_x,dv_y,dv_z", "t w:i a:i", lines=lambda s: [",".join([f"{t:.3f}", *(f"{v:.9g}" for v in s["w"][k] / RATE), *(f"{v:.9g}" for v in s["a"][k] / RATE)]) for k, t in enumerate(T)], want="wa")
add("increments, delta names", "time,DeltaAngle_X,DeltaAngle_Y,DeltaAngle_Z,DeltaVelocity_X,DeltaVelocity_Y,DeltaVelocity_Z", "t", lines=lambda s: [",".join([f"{t:.3f}", *(f"{v:.9g}" for v in s["w"][k] / RATE), *(f"{v:.9g}" for v in s["a"][k] / RATE)]) for k, t in enumerate(T)], want="wa")
add("VNYMR", "", "", lines=lambda s: [f"$VNYMR,+010.0{k%10},+000.5,-001.2," + ",".join(f"{v:+08.4f}" for v in [*(s["m"][k] / 1e-4), *s["a"][k], *s["w"][k]]) + f"*{k % 256:02X}" for k in range(N)], want="awm", file="log.txt", given={"rate": 100})
add("VNYMR no rate", "", "", lines=lambda s: [f"$VNYMR,+010.0{k%10},+000.5,-001.2," + ",".join(f"{v:+08.4f}" for v in [*(s["m"][k] / 1e-4), *s["a"][k], *s["w"][k]]) + f"*{k % 256:02X}" for k in range(N)], want="awm", file="log.txt")
add("VNIMU", "", "", lines=lambda s: ["$VNIMU," + ",".join(f"{v:+08.4f}" for v in [*(s["m"][k] / 1e-4), *s["a"][k], *s["w"][k]]) + f",+25.1,+101.1*{k % 256:02X}" for k in range(N)], want="awm", file="log.txt")
add("DataFlash text", "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 129, 31, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\nFMT, 130, 31, ATT, Qfff, TimeUS,Roll,Pitch,Yaw", "", lines=lambda s: [one for k, t in enumerate(T) for one in ([f"IMU, {int(7e6 + 1e4 * k)}, 0, " + ", ".join(f"{v:.7g}" for v in [*s["w"][k], *s["a"][k]])] + [f"ATT, {int(7e6 + 1e4 * k)}, 1.0, 2.0, 3.0"] * (k % 5 == 0))], want="wa", file="flight.log")
add("ADIS names", "XGYRO_OUT,YGYRO_OUT,ZGYRO_OUT,XACCL_OUT,YACCL_OUT,ZACCL_OUT,TEMP_OUT", "w:d a:mg tmp")
add("ADIS names timed", "Time (s),X_GYRO_OUT,Y_GYRO_OUT,Z_GYRO_OUT,X_ACCL_OUT,Y_ACCL_OUT,Z_ACCL_OUT", "t w:d a:g")
add("ADIS names timed 2", "timestamp,DATA_CNTR,XGYRO_OUT,YGYRO_OUT,ZGYRO_OUT,XACCL_OUT,YACCL_OUT,ZACCL_OUT,TEMP_OUT", "t i w:d a:mg tmp")
add("Accelerometer (x)", "Time [s],Accelerometer (x) [m/s2],Accelerometer (y) [m/s2],Accelerometer (z) [m/s2],Gyroscope (x) [rad/s],Gyroscope (y) [rad/s],Gyroscope (z) [rad/s]", "t a:m w:r")
add("scaledAccel", "time,scaledAccelX,scaledAccelY,scaledAccelZ,scaledGyroX,scaledGyroY,scaledGyroZ", "t a:g w:r")
add("quoted decimal commas", '"time","ax","ay","az"', "t a:m", lines=lambda s: [",".join('"' + f"{v:.4f}".replace(".", ",") + '"' for v in [t, *s["a"][k]]) for k, t in enumerate(T)])
add("checksum column", "time,ax,ay,az,gx,gy,gz,checksum", "t a:g w:d kh")
add("checksum column number", "time,ax,ay,az,gx,gy,gz,crc", "t a:g w:d k")
add("checksum without name", "time,ax,ay,az,gx,gy,gz", "t a:g w:d kh")
add("surplus field", "time,ax,ay,az,gx,gy,gz", "t a:g w:d k")
add("surplus field empty", "time,ax,ay,az,gx,gy,gz", "t a:g w:d z z")
add("header with a surplus name", "time,ax,ay,az,gx,gy,gz,label", "t a:g w:d")
add("X/Y/Z over three lines", "", "", lines=lambda s: [f"{x.upper()}: {s['a'][k][j]:.4f}" for k in range(N) for j, x in enumerate("xyz")], want="a", file="log.txt", given={"rate": 100})
add("AX over six lines", "", "", lines=lambda s: [f"{n}{x.upper()} = {s[q][k][j]:.4f}" for k in range(N) for n, q in (("A", "a"), ("G", "w")) for j, x in enumerate("xyz")], want="aw", file="log.txt", given={"rate": 100})
add("JSON lines of DataFlash", "", "", lines=lambda s: ['{"meta": {"type": "IMU", "timestamp": %.6f}, "data": {"TimeUS": %d, "I": 0, "GyrX": %.7g, "GyrY": %.7g, "GyrZ": %.7g, "AccX": %.7g, "AccY": %.7g, "AccZ": %.7g}}' % (E0 + t, 7e6 + 1e6 * t, *s["w"][k], *s["a"][k]) for k, t in enumerate(T)], want="wa", file="log.json")
add("Sensor Logger JSON", "", "", lines=lambda s: ["[" + ",\n".join(one for k, t in enumerate(T) for one in ['{"sensor":"Accelerometer","time":"%d","seconds_elapsed":"%.4f","x":"%.6f","y":"%.6f","z":"%.6f"}' % (E0 * 10**9 + round(t * 1e9), t + 0.1, *s["f"][k]), '{"sensor":"Gyroscope","time":"%d","seconds_elapsed":"%.4f","z":"%.7g","y":"%.7g","x":"%.7g"}' % (E0 * 10**9 + round(t * 1e9), t + 0.1, *s["w"][k][::-1]), '{"sensor":"TotalAcceleration","time":"%d","seconds_elapsed":"%.4f","x":"%.7g","y":"%.7g","z":"%.7g"}' % (E0 * 10**9 + round(t * 1e9), t + 0.1, *s["a"][k])]) + "]"], want="wa", file="log.json")
add("RAWIMUSA", "", "", lines=lambda s: [f"%RAWIMUSA,2245,{390884 + t:.3f};2245,{390884 + t:.9f},00000077," + ",".join(str(int(v)) for v in s["a"][k] * 1000) + "*12345678" for k, t in enumerate(T)], refuse="not_a_log", file="log.asc")
# --- phone apps
add("phyphox accel", '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)","Absolute acceleration (m/s^2)"', "t a:m norm:m")
add("phyphox linear", '"Time (s)","Linear Acceleration x (m/s^2)","Linear Acceleration y (m/s^2)","Linear Acceleration z (m/s^2)"', "t f:m", refuse="gravity_free")
add("phyphox tab", "Time (s)\tGyroscope x (rad/s)\tGyroscope y (rad/s)\tGyroscope z (rad/s)\tAbsolute (rad/s)", "t w:r n:1.5", mark="\t", file="Raw Data.csv")
add("phyphox mag", '"Time (s)";"Magnetic field x (\u00b5T)";"Magnetic field y (\u00b5T)";"Magnetic field z (\u00b5T)"', "t m:uT", mark=";")
add("SensorLog", "loggingTime(txt),loggingSample(N),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s),motionYaw(rad),motionRoll(rad),motionPitch(rad),motionUserAccelerationX(G),motionUserAccelerationY(G),motionUserAccelerationZ(G)", "D i t a:g t w:r e f:g")
add("SensorLog motion", "loggingTime(txt),motionTimestamp_sinceReboot(s),motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s),motionGravityX(G),motionGravityY(G),motionGravityZ(G),motionUserAccelerationX(G),motionUserAccelerationY(G),motionUserAccelerationZ(G)", "D t w:r v:g f:g", want="w")
add("AndroSensor", "ACCELEROMETER X (m/s\u00b2);ACCELEROMETER Y (m/s\u00b2);ACCELEROMETER Z (m/s\u00b2);GRAVITY X (m/s\u00b2);GRAVITY Y (m/s\u00b2);GRAVITY Z (m/s\u00b2);LINEAR ACCELERATION X (m/s\u00b2);LINEAR ACCELERATION Y (m/s\u00b2);LINEAR ACCELERATION Z (m/s\u00b2);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);MAGNETIC FIELD X (\u03bcT);MAGNETIC FIELD Y (\u03bcT);MAGNETIC FIELD Z (\u03bcT);Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS", "a:m v:m f:m w:r m:uT tms D", mark=";")
add("Physics Toolbox", "time;gFx;gFy;gFz;wx;wy;wz", "t a:g w:r", mark=";")
add("Sensor Kinetics", "Time since start in seconds ,X value,Y value,Z value", "t a:m", file="accelerometer.csv")
add("PowerSense", "timestamp,accelerometerAccelX,accelerometerAccelY,accelerometerAccelZ,gyroscopeRotX,gyroscopeRotY,gyroscopeRotZ", "Ts a:g w:r")
add("Sensor Logger combined", "time,seconds_elapsed,TotalAcceleration_x,TotalAcceleration_y,TotalAcceleration_z,Gyroscope_x,Gyroscope_y,Gyroscope_z,Magnetometer_x,Magnetometer_y,Magnetometer_z", "Tns t a:m w:r m:uT")
add("HyperIMU", "Timestamp,accelerometer.x,accelerometer.y,accelerometer.z,gyroscope.x,gyroscope.y,gyroscope.z,magnetic.x,magnetic.y,magnetic.z", "tms a:m w:r m:uT")
add("HyperIMU real", "timestamp,LSM6DSO Accelerometer.x,LSM6DSO Accelerometer.y,LSM6DSO Accelerometer.z,LSM6DSO Gyroscope.x,LSM6DSO Gyroscope.y,LSM6DSO Gyroscope.z", "Tms a:m w:r")
add("Matlab Mobile", "timestamp,X,Y,Z", "D a:m", file="Acceleration.csv")
add("Matlab Mobile 2", "Timestamp,X,Y,Z", "D w:r", file="AngularVelocity.csv")
add("GetSensorData", "", "", lines=lambda s: [one for k, t in enumerate(T) for one in [f"ACCE;{t:.3f};{t+5:.3f};" + ";".join(f"{v:.5f}" for v in s["a"][k]) + ";3", f"GYRO;{t+.001:.3f};{t+5:.3f};" + ";".join(f"{v:.5f}" for v in s["w"][k]) + ";3"]], want="aw", file="logfile.txt")
add("OxIOD", "Time,attitude_roll(radians),attitude_pitch(radians),attitude_yaw(radians),rotation_rate_x(radians/s),rotation_rate_y(radians/s),rotation_rate_z(radians/s),gravity_x(G),gravity_y(G),gravity_z(G),user_acc_x(G),user_acc_y(G),user_acc_z(G),magnetic_field_x(microteslas),magnetic_field_y(microteslas),magnetic_field_z(microteslas)", "t e w:r v:g f:g m:uT", want="wm")
add("OxIOD no header", "", "t e w:r v:g f:g m:uT", want="wm", refuse="columns_unclear")
add("iPhone DeviceMotion", "timestamp,rotationRate.x,rotationRate.y,rotationRate.z,userAcceleration.x,userAcceleration.y,userAcceleration.z,attitude.roll,attitude.pitch,attitude.yaw", "Ts w:r f:g e", want="w")
add("Web DeviceMotion", "t,accelerationIncludingGravity.x,accelerationIncludingGravity.y,accelerationIncludingGravity.z,acceleration.x,acceleration.y,acceleration.z,rotationRate.alpha,rotationRate.beta,rotationRate.gamma,interval", "tms a:m f:m wzxy:d n:16", want="aw")
add("Movesense", "Timestamp (ms),x (m/s^2),y (m/s^2),z (m/s^2)", "tms a:m", file="Acc.csv")
add("Polar", "Phone timestamp;sensor timestamp [ns];X [mg];Y [mg];Z [mg]", "D tns a:mg", mark=";", file="Polar_H10_ACC.txt")
add("Garmin", "timestamp_ms,acc_x_mg,acc_y_mg,acc_z_mg", "tms a:mg")
# --- boards and sensors
add("Shimmer", 'sep=\t\nShimmer_B3E7_Timestamp_Unix_CAL\tShimmer_B3E7_Accel_LN_X_CAL\tShimmer_B3E7_Accel_LN_Y_CAL\tShimmer_B3E7_Accel_LN_Z_CAL\tShimmer_B3E7_Gyro_X_CAL\tShimmer_B3E7_Gyro_Y_CAL\tShimmer_B3E7_Gyro_Z_CAL\tShimmer_B3E7_Mag_X_CAL\tShimmer_B3E7_Mag_Y_CAL\tShimmer_B3E7_Mag_Z_CAL\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tdeg/s\tdeg/s\tdeg/s\tlocal_flux\tlocal_flux\tlocal_flux', "Tms a:m w:d m:G", want="aw", mark="\t")
add("MetaWear", "epoch (ms),time (-13:00),elapsed (s),x-axis (g),y-axis (g),z-axis (g)", "Tms D t a:g", file="MetaWear_2020_Accelerometer.csv")
add("MetaWear gyro", "epoch (ms),timestamp (-0700),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)", "Tms D t w:d", file="MetaWear_Gyroscope_100.000Hz_1.4.csv")
add("WitMotion", "Time(s)\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\tAngleX(deg)\tAngleY(deg)\tAngleZ(deg)\tT(\u00b0)", "t a:g w:d e tmp", mark="\t", file="w.txt")
add("WitMotion Chinese", "\u65f6\u95f4,\u8bbe\u5907\u540d\u79f0,\u7247\u4e0a\u65f6\u95f4(),\u52a0\u901f\u5ea6X(g),\u52a0\u901f\u5ea6Y(g),\u52a0\u901f\u5ea6Z(g),\u89d2\u901f\u5ea6X(\u00b0/s),\u89d2\u901f\u5ea6Y(\u00b0/s),\u89d2\u901f\u5ea6Z(\u00b0/s),\u89d2\u5ea6X(\u00b0),\u89d2\u5ea6Y(\u00b0),\u89d2\u5ea6Z(\u00b0),\u78c1\u573aX(ut),\u78c1\u573aY(ut),\u78c1\u573aZ(ut)", "D s:WT D a:g w:d e m:uT", encoding="gb18030")
add("LPMS", "SensorId, TimeStamp (s), FrameNumber, AccX (g), AccY (g), AccZ (g), GyroX (deg/s), GyroY (deg/s), GyroZ (deg/s), MagX (uT), MagY (uT), MagZ (uT), EulerX (deg), EulerY (deg), EulerZ (deg), QuatW, QuatX, QuatY, QuatZ, LinAccX (g), LinAccY (g), LinAccZ (g), Pressure (kPa)", "n:1 t i a:g w:d m:uT e q f:g p")
add("NGIMU", "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g),Magnetometer X (uT),Magnetometer Y (uT),Magnetometer Z (uT),Barometer (hPa)", "t w:d a:g m:uT p")
add("x-IMU3", "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)", "tus w:d a:g")
add("x-IMU", "Packet number,Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g),Magnetometer X (G),Magnetometer Y (G),Magnetometer Z (G)", "i w:d a:g m:G", file="x_CalInertialAndMag.csv")
add("ST", "hh:mm:ss.ms,AccX [mg],AccY [mg],AccZ [mg],GyroX [mdps],GyroY [mdps],GyroZ [mdps],MagX [mGa],MagY [mGa],MagZ [mGa]", "C a:mg w:md m:mG")
add("ST iNEMO", "timer\tA_x [mg]\tA_y [mg]\tA_z [mg]\tG_x [dps]\tG_y [dps]\tG_z [dps]\tM_x [mG]\tM_y [mG]\tM_z [mG]", "tms a:mg w:d m:mG", mark="\t")
add("STBLESensor", "Date,HostTimestamp (ms),NodeName,NodeTimestamp,RawData,X (mg),Y (mg),Z (mg)", "D tms s:NODE tms s:AA a:mg", file="20230501_Accelerometer.csv")
add("OpenLog Artemis", "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz", "Du C a:mg w:d m:uT tmp n:100.000")
add("Razor", "", "", lines=lambda s: ["#YPR=0.1,0.2,0.3"] * 0 + [f"#A-C={s['a'][k][0]:.2f},{s['a'][k][1]:.2f},{s['a'][k][2]:.2f}" for k in range(N)], refuse=True, file="log.txt")
add("Arduino Nano", "aX,aY,aZ,gX,gY,gZ", "a:g w:d")
add("Arduino Nano ms", "millis,aX,aY,aZ,gX,gY,gZ", "tms a:g w:d")
add("MPU counts", "ax,ay,az,gx,gy,gz,t", "a:c w:c tms", expect="counts")
add("MPU names", "Time,AcX,AcY,AcZ,Tmp,GyX,GyY,GyZ", "tms a:c tmp w:c", expect="counts")
add("BNO055", "time_ms,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,mag_x,mag_y,mag_z,euler_h,euler_r,euler_p,lia_x,lia_y,lia_z,grv_x,grv_y,grv_z", "tms w:d a:m m:uT e f:m v:m")
add("ICM20948", "timestamp_us,acc_x_mg,acc_y_mg,acc_z_mg,gyr_x_dps,gyr_y_dps,gyr_z_dps,mag_x_uT,mag_y_uT,mag_z_uT,tmp_c", "tus a:mg w:d m:uT tmp")
add("OpenIMU", "time,xAccel,yAccel,zAccel,xRate,yRate,zRate,xMag,yMag,zMag", "t a:m w:d m:G")
add("OpenIMU units", "time (msec), xAccel (m/s^2), yAccel (m/s^2), zAccel (m/s^2), xRate (deg/s), yRate (deg/s), zRate (deg/s), xMag (Gauss), yMag (Gauss), zMag (Gauss), temp (C)", "tms a:m w:d m:G tmp")
add("MicroStrain", "Time,X Accel [x8004],Y Accel [x8004],Z Accel [x8004],X Gyro [x8005],Y Gyro [x8005],Z Gyro [x8005]", "t a:g w:r")
add("VectorNav CSV", "VNYPR.Yaw,VNIMU.Accel.X,VNIMU.Accel.Y,VNIMU.Accel.Z,VNIMU.Gyro.X,VNIMU.Gyro.Y,VNIMU.Gyro.Z,VNTime.TimeStartup", "p a:m w:r tns")
add("SBG", "timestamp,status,accelX,accelY,accelZ,gyroX,gyroY,gyroZ,temperature,deltaVelX,deltaVelY,deltaVelZ,deltaAngleX,deltaAngleY,deltaAngleZ", "tus n:255 a:m w:r tmp a:m w:r", want="aw")
add("SBG units", "Timestamp\tAcceleration X\tAcceleration Y\tAcceleration Z\tRate of Turn X\tRate of Turn Y\tRate of Turn Z\n(us)\t(m.s^-2)\t(m.s^-2)\t(m.s^-2)\t(\u00b0.s^-1)\t(\u00b0.s^-1)\t(\u00b0.s^-1)", "tus a:m w:d", mark="\t")
add("Xsens MT", "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Filter Profile: human\nPacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z", "i tus a:m w:r m:rel", want="aw", mark="\t",  file="MT.txt")
add("Movella DOT", "Measurement Mode:,Custom\nDeviceTag:,D1\nOutputRate:,100Hz\nPacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z", "i tus a:m w:d")
add("Inertial Sense", "time,pqr[0],pqr[1],pqr[2],acc[0],acc[1],acc[2],status", "t w:r a:m n:3")
add("iXblue", "Time,XV1_ROT,XV2_ROT,XV3_ROT,XV1_ACC,XV2_ACC,XV3_ACC", "t w:d a:m")
add("KVH", "time,delta_x,delta_y,delta_z,accel_x,accel_y,accel_z,temp", "t n3 a:g tmp", want="a")
add("Novatel converted", "Week,GPSTime,AccX(m/s2),AccY(m/s2),AccZ(m/s2),GyroX(deg/s),GyroY(deg/s),GyroZ(deg/s)", "week tow a:m w:d")
add("Gladiator", "Time;GyroX[deg/sec];GyroY[deg/sec];GyroZ[deg/sec];AccelX[G];AccelY[G];AccelZ[G];Temp", "t w:d a:g tmp", mark=";")
add("Honeywell", "msgcnt, wx (rad/sec), wy (rad/sec), wz (rad/sec), ax (m/sec^2), ay (m/sec^2), az (m/sec^2)", "i w:r a:m")
add("Epson", "Count,GyroX,GyroY,GyroZ,AccelX,AccelY,AccelZ,Temperature", "i w:d a:mg tmp")
add("Epson no", "No.,TIME[sec],Gx[deg/s],Gy[deg/s],Gz[deg/s],Ax[mG],Ay[mG],Az[mG],Ts[deg.C]", "i t w:d a:mg tmp")
add("Bosch dev", "Timestamp[ms],Ax[m/s^2],Ay[m/s^2],Az[m/s^2],Gx[dps],Gy[dps],Gz[dps]", "tms a:m w:d")
add("TDK", "Timestamp,Accel_X,Accel_Y,Accel_Z,Gyro_X,Gyro_Y,Gyro_Z,Temp", "tus a:g w:d tmp")
add("Tinkerforge long", "TIME,NAME,UID,VAR,RAW,UNIT", "", lines=lambda s: [f"{E0 + t:.3f},IMU,6x,acc_{x},{s['a'][k][j] / G * 1000:.0f},mg" for k, t in enumerate(T) for j, x in enumerate("xyz")], refuse=True)
add("Phidgets", "Time,AccX,AccY,AccZ,GyroX,GyroY,GyroZ,FieldX,FieldY,FieldZ", "tms a:g w:d m:G")
add("Adafruit", "Timestamp, Acceleration X, Acceleration Y, Acceleration Z, Gyro X, Gyro Y, Gyro Z, Magnetic X, Magnetic Y, Magnetic Z", "t a:m w:r m:uT")
add("micro:bit", "Time (seconds),accelerometer x,accelerometer y,accelerometer z", "t a:mg")
add("Sense HAT", "timestamp,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,temp,humidity,pressure,pitch,roll,yaw", "D a:g w:r m:uT tmp p p e")
# --- data loggers and lab software
add("TOA5", '"TOA5","CR6","CR6","1","OS","CPU:p.CR6","1","T1"\n"TIMESTAMP","RECORD","Ax","Ay","Az"\n"TS","RN","g","g","g"\n"","","Smp","Smp","Smp"', "D i a:g", edit=lambda line: '"' + line.replace(",", '",', 1), file="t.dat")
add("HOBO", '"Plot Title: x"\n"#","Date Time, GMT+00:00","X Accel, g","Y Accel, g","Z Accel, g"', "i D a:g")
add("GCDC", ";Title, http://www.gcdataconcepts.com, X2\n;Version, 1\n;Start_time, 2023-05-01, 11:59:58.000\n;SampleRate, 100,Hz\n;Headers, time,Ax,Ay,Az", "t a:c", expect="counts")
add("enDAQ", "timestamp,X (40g),Y (40g),Z (40g)", "t a:g")
add("enDAQ acc", '"Time","\\"X (500g)\\", \\"g\\""', "t a:g")
add("DeweSoft", "Time (s);Ax (g);Ay (g);Az (g)", "t a:g", mark=";", edit=lambda line: line.replace(".", ","))
add("Delsys", "X[s],Trigno sensor 1: ACC.X 1[g],X[s],Trigno sensor 1: ACC.Y 1[g],X[s],Trigno sensor 1: ACC.Z 1[g]", "", lines=lambda s: [",".join(f"{t:.3f},{v:.6f}" for v in s["a"][k] / G) for k, t in enumerate(T)], want="a")
add("Vicon", "Devices\n100\n,,IMU - Accel,,,IMU - Gyro,,\nFrame,Sub Frame,x,y,z,x,y,z\n,,m/s\u00b2,m/s\u00b2,m/s\u00b2,deg/s,deg/s,deg/s", "i n:0 a:m w:d")
add("Noraxon", "time,Shank LT Accel Sens X (mG),Shank LT Accel Sens Y (mG),Shank LT Accel Sens Z (mG)", "t a:mg")
add("ActiGraph raw", "------------ Data File Created By ActiGraph GT3X+ ActiLife v6.13.3 Firmware v1.9.2 date format M/d/yyyy at 100 Hz  Filter Normal -----------\nSerial Number: X\nStart Time 11:59:58\nStart Date 5/1/2023\nEpoch Period (hh:mm:ss) 00:00:00\nDownload Time 12:00:00\nDownload Date 5/2/2023\nCurrent Memory Address: 0\nCurrent Battery Voltage: 4.1     Mode = 12\n--------------------------------------------------\nAccelerometer X,Accelerometer Y,Accelerometer Z", "a:g")
add("ActiGraph IMU", "Timestamp,Accelerometer X,Accelerometer Y,Accelerometer Z,Temperature,Gyroscope X,Gyroscope Y,Gyroscope Z,Magnetometer X,Magnetometer Y,Magnetometer Z", "D a:g tmp w:d m:uT")
add("Axivity CSV", "", "D a:g", file="cwa.csv")
add("GENEActiv CSV", "Device Type,GENEActiv\nMeasurement Frequency,100 Hz\nStart Time,2023-05-01 11:59:58:000\n" + "\n".join(f"Header {k},x" for k in range(20)), "D a:g n:12 n:0 tmp", want="a", refuse="columns_unclear")
add("BioStamp", "Timestamp (microseconds),Accel X (g),Accel Y (g),Accel Z (g)", "Tus a:g")
add("Empatica E4", "1700000000.0,1700000000.0,1700000000.0\n100.0,100.0,100.0", "a:g", file="ACC.csv", lines=lambda s: [",".join(f"{v * 64 / G:.0f}" for v in s["a"][k]) for k in range(N)], known={"accel": f"{1/64} g"}, tolerance=0.02)
add("APDM CSV", "Time (s),Sensor 1/Accelerometer X (m/s^2),Sensor 1/Accelerometer Y (m/s^2),Sensor 1/Accelerometer Z (m/s^2),Sensor 1/Gyroscope X (rad/s),Sensor 1/Gyroscope Y (rad/s),Sensor 1/Gyroscope Z (rad/s)", "t a:m w:r")
# --- robots, drones, vehicles
add("EuRoC", "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]", "Tns w:r a:m", file="data.csv")
add("KITTI oxts", "lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu", "L e p p n3 a:m v:m w:r w:r", want="aw", mark=" ", file="oxts.txt")
add("Boreas", "GPSTime,angvel_z,angvel_y,angvel_x,accelz,accely,accelx", "Ts wzyx:r azyx:m")
add("NCLT", "", "Tus m:G a:m w:r", file="ms25.csv")
add("rostopic -p", "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.orientation.x,field.orientation.y,field.orientation.z,field.orientation.w,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z,field.linear_acceleration.x,field.linear_acceleration.y,field.linear_acceleration.z", "Tns i Tns s:imu q w:r a:m")
add("bagpy", "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "Ts i sec nsec s:imu w:r a:m")
add("PlotJuggler", "__time,/imu/data/angular_velocity/x,/imu/data/angular_velocity/y,/imu/data/angular_velocity/z,/imu/data/linear_acceleration/x,/imu/data/linear_acceleration/y,/imu/data/linear_acceleration/z", "Ts w:r a:m")
add("PX4 csv", "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count,clip_counter[0],clip_counter[1],clip_counter[2],samples", "tus tus n:2818058 w:r tmp n:0 n:0 n:0 n:0 n:4", file="log_1_sensor_gyro_0.csv")
add("PX4 combined csv", "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt", "tus w:r n:4000 n:0 a:m n:4000", file="log_sensor_combined_0.csv")
add("PX4 mag csv", "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count", "tus tus n:396825 m:G tmp n:0", file="log_sensor_mag_0.csv")
add("mavlogdump csv", "timestamp,TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", "Ts tus n:0 w:r a:m n:0 n:0 tmp n:1 n:1 n:1000 n:1000")
add("SCALED_IMU", "timestamp,time_boot_ms,xacc,yacc,zacc,xgyro,ygyro,zgyro,xmag,ymag,zmag,temperature", "Ts tms a:mg w:mr m:mG tmp")
add("QGC", "Timestamp,rawImu.xacc,rawImu.yacc,rawImu.zacc,rawImu.xgyro,rawImu.ygyro,rawImu.zgyro", "D a:mg w:mr")
add("DJI", "Clock:offsetTime,IMU_ATTI(0):accelX,IMU_ATTI(0):accelY,IMU_ATTI(0):accelZ,IMU_ATTI(0):gyroX,IMU_ATTI(0):gyroY,IMU_ATTI(0):gyroZ,IMU_ATTI(0):magX,IMU_ATTI(0):magY,IMU_ATTI(0):magZ", "t a:g w:d m:uT")
add("DJI brackets", "tickNo,offsetTime,ATTI_PRINTF(0):accelX[meters/sec2],ATTI_PRINTF(0):accelY[meters/sec2],ATTI_PRINTF(0):accelZ[meters/sec2],gyroX[degrees/sec],gyroY[degrees/sec],gyroZ[degrees/sec]", "I t a:m w:d")
add("Betaflight csv", "loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],accSmooth[1],accSmooth[2]", "i tus w:d a:c", lines=lambda s: [",".join([str(k), f"{7e6 + 1e6 * t:.0f}", *(f"{v:.3f}" for v in s["w"][k] / DEG), *(f"{v:.0f}" for v in s["a"][k] / G * 2048)]) for k, t in enumerate(T)], known={"accel": f"{1/2048:.12g} g"})
add("Kalibr", "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z", "Tns w:r a:m")
add("ZED", "timestamp,angular_velocity_x,angular_velocity_y,angular_velocity_z,linear_acceleration_x,linear_acceleration_y,linear_acceleration_z", "Tns w:d a:m")
add("RealSense", "timestamp_ms,accel_x,accel_y,accel_z", "tms a:m")
add("ARCore", "imu_time,imu_gx,imu_gy,imu_gz,imu_ax,imu_ay,imu_az", "tns w:r a:m")
add("AirSim", "TimeStamp\tACC_X\tACC_Y\tACC_Z\tANG_VEL_X\tANG_VEL_Y\tANG_VEL_Z\tQ_W\tQ_X\tQ_Y\tQ_Z", "Tns a:m w:r q", mark="\t")
add("CARLA", "frame,timestamp,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,compass", "i t a:m w:r n:1.2")
add("nuScenes", "", "", lines=lambda s: ["[" + ",\n".join('{"linear_accel": [%.6f, %.6f, %.6f], "orientation": [1.0, 0.0, 0.0, 0.0], "rotation_rate": [%.6f, %.6f, %.6f], "utime": %d}' % (*s["a"][k], *s["w"][k], E0 * 10**6 + round(t * 1e6)) for k, t in enumerate(T)) + "]"], want="aw", file="scene-0061_ms_imu.json")
add("comma", "t,accelerometer.v[0],accelerometer.v[1],accelerometer.v[2],gyro.v[0],gyro.v[1],gyro.v[2]", "t a:m w:r")
add("Gyroflow", "GYROFLOW IMU LOG\nversion,1.3\nid,x\ntscale,0.001\ngscale,0.017453292519943\nascale,1\nt,gx,gy,gz,ax,ay,az", "tms w:d a:g", file="x.gcsv")
add("Blackbox sections", "time (us), gyroX, gyroY, gyroZ, accX, accY, accZ", "tus w:d a:g")
# --- plain habits
add("no header 7", "", "t w:r a:m")
add("no header 7 deg g", "", "t w:d a:g")
add("no header 10", "", "t w:r a:m m:uT")
add("no header 4 accel", "", "t a:m")
add("no header 4 file", "", "t w:r", file="gyro.csv")
add("no header 4 mag file", "", "t m:uT", file="magnetometer.txt")
add("imu_tk", "", "", lines=lambda s: [f"   {t:.7e}   " + "   ".join(f"{v:.7e}" for v in s["a"][k]) for k, t in enumerate(T)], want="a", file="xsens_acc.mat.txt")
add("x y z and file", "t,x,y,z", "t a:m", file="accel.csv")
add("x y z no word", "t,x,y,z", "t a:m")
add("x y z no word gyro", "t,x,y,z", "t w:r")
add("x y z no word mag", "t,x,y,z", "t m:uT", knows={"columns": {"mag": "1:3"}})
add("x y z with units", "t (s),x (m/s^2),y (m/s^2),z (m/s^2)", "t a:m")
add("X Y Z uT", "Time,X (uT),Y (uT),Z (uT)", "t m:uT")
add("two triples x y z", "t,x,y,z,x,y,z", "t a:m w:r")
add("unit line", "time,ax,ay,az,gx,gy,gz\ns,g,g,g,deg/s,deg/s,deg/s", "t a:g w:d")
add("unit line braces", "time,ax,ay,az,gx,gy,gz\n[s],[g],[g],[g],[dps],[dps],[dps]", "t a:g w:d")
add("spaces aligned", "   time        ax        ay        az", "", lines=lambda s: [f"{t:8.3f}" + "".join(f"{v:10.5f}" for v in s["a"][k]) for k, t in enumerate(T)], want="a", file="log.txt")
add("German", "Zeit;Beschleunigung X;Beschleunigung Y;Beschleunigung Z;Drehrate X;Drehrate Y;Drehrate Z", "t a:m w:d", mark=";", edit=lambda line: line.replace(".", ","))
add("French", "Temps (s);Acc\u00e9l\u00e9ration X (m/s\u00b2);Acc\u00e9l\u00e9ration Y (m/s\u00b2);Acc\u00e9l\u00e9ration Z (m/s\u00b2);Vitesse angulaire X (rad/s);Vitesse angulaire Y (rad/s);Vitesse angulaire Z (rad/s)", "t a:m w:r", mark=";")
add("Spanish", "Tiempo (s),Aceleraci\u00f3n X (m/s\u00b2),Aceleraci\u00f3n Y (m/s\u00b2),Aceleraci\u00f3n Z (m/s\u00b2)", "t a:m")
add("Japanese", "\u6642\u9593,\u52a0\u901f\u5ea6X[G],\u52a0\u901f\u5ea6Y[G],\u52a0\u901f\u5ea6Z[G],\u89d2\u901f\u5ea6X[dps],\u89d2\u901f\u5ea6Y[dps],\u89d2\u901f\u5ea6Z[dps]", "t a:g w:d")
add("roll pitch yaw rates", "time,roll_rate,pitch_rate,yaw_rate,accel_x,accel_y,accel_z", "t w:d a:m")
add("p q r", "time,p,q,r,nx,ny,nz", "t w:r a:g")
add("p q r ax", "time,p,q,r,ax,ay,az", "t w:r a:m")
add("numbered", "t,acc1,acc2,acc3,gyr1,gyr2,gyr3", "t a:m w:d")
add("two IMUs", "t,imu0_ax,imu0_ay,imu0_az,imu0_gx,imu0_gy,imu0_gz,imu1_ax,imu1_ay,imu1_az,imu1_gx,imu1_gy,imu1_gz", "t a:m w:r a:m w:r")
add("wrist", "timestamp,wrist_acc_x,wrist_acc_y,wrist_acc_z,wrist_gyr_x,wrist_gyr_y,wrist_gyr_z", "Tms a:m w:d")
add("IMU_ names", "TIMESTAMP,IMU_ACC_X,IMU_ACC_Y,IMU_ACC_Z,IMU_GYRO_X,IMU_GYRO_Y,IMU_GYRO_Z,IMU_TEMP", "tms a:g w:d tmp")
add("specific force", "TOW,f_x,f_y,f_z,w_x,w_y,w_z", "tow a:m w:r")
add("fb wb", "t,f_ib_b_x,f_ib_b_y,f_ib_b_z,omega_ib_b_x,omega_ib_b_y,omega_ib_b_z", "t a:m w:r")
add("forward left up", "t,acc_fwd,acc_left,acc_up,gyro_fwd,gyro_left,gyro_up", "t a:m w:r", refuse=True)
add("body axes", "t,ax_body,ay_body,az_body,wx_body,wy_body,wz_body", "t a:m w:r")
add("label at the end", "timestamp,ax,ay,az,gx,gy,gz,activity", "Tms a:g w:d s:walk")
add("tabs and index", "\tt\tax\tay\taz", "i t a:m", mark="\t")
add("two clocks", "sys_time,dev_time,ax,ay,az,gx,gy,gz", "Ts tms a:g w:d")
add("norms beside", "time,acc_x,acc_y,acc_z,acc_norm,gyro_x,gyro_y,gyro_z", "t a:m norm:m w:r")
add("raw and filtered", "t,ax_filt,ay_filt,az_filt,ax_raw,ay_raw,az_raw", "t a:m a:m")
add("calibration columns", "t,acc_x,acc_y,acc_z,acc_bias_x,acc_bias_y,acc_bias_z,gyr_x,gyr_y,gyr_z", "t a:m n3 w:r")
add("std columns", "t,gyro_x,gyro_y,gyro_z,gyro_std_x,gyro_std_y,gyro_std_z", "t w:r n3")
add("setpoints", "t,rate_setpoint_x,rate_setpoint_y,rate_setpoint_z,gyro_x,gyro_y,gyro_z", "t n3 w:r")
add("jerk", "t,jerk_x,jerk_y,jerk_z", "t n3", refuse="no_sensor")
add("angular acceleration", "t,angular_acceleration_x,angular_acceleration_y,angular_acceleration_z,gyro_x,gyro_y,gyro_z", "t n3 w:r")
add("angular acceleration alone", "t,angular_acceleration_x,angular_acceleration_y,angular_acceleration_z", "t n3", refuse=True)
add("forces of a plate", "Time,Fx,Fy,Fz,Mx,My,Mz,COPx,COPy", "t n3 n3 p p", refuse=True)
add("markers", "Frame,Time,LASI_x,LASI_y,LASI_z,RASI_x,RASI_y,RASI_z", "i t n3 n3", refuse=True)
add("joint torques", "t,tau_x,tau_y,tau_z", "t n3", refuse=True)
add("velocities", "t,vx,vy,vz", "t n3", refuse="no_sensor")
add("positions", "t,x,y,z,vx,vy,vz", "t n3 n3", refuse=True)
add("motor currents", "t,i_x,i_y,i_z", "t n3", refuse=True)
add("colours", "t,r,g,b", "t n3", refuse=True)
add("weather", "time,temperature,humidity,pressure", "t tmp p p", want="", refuse=None, weather=True)
# statements against options
add("units against header", "t [s],gx [rad/s],gy [rad/s],gz [rad/s]", "t w:r", given={"units": {"gyro": "deg/s"}}, said="against_header")
add("phone mag hard iron", "time,x,y,z", "t", lines=lambda s: [f"{t:.3f}," + ",".join(f"{v:.3f}" for v in s["m"][k] * 1e6 + [300, -250, 260]) for k, t in enumerate(T)], file="magnetometer.csv", given={"units": {"mag": "uT"}}, hardiron=True, want="m")

# --- written afterwards
add("accel_mss", "time_usec,accel_x_mss,accel_y_mss,accel_z_mss,gyro_x_rads,gyro_y_rads,gyro_z_rads", "tus a:m w:r")
add("elapsed", "elapsed_ms,AccelX_g,AccelY_g,AccelZ_g,GyroX_dps,GyroY_dps,GyroZ_dps", "tms a:g w:d")
add("Core Motion rotation", "time,acceleration_x,acceleration_y,acceleration_z,rotation_x,rotation_y,rotation_z", "t a:g w:r")
add("two feet", "Timestamp,LeftFoot_Acc_X,LeftFoot_Acc_Y,LeftFoot_Acc_Z,LeftFoot_Gyro_X,LeftFoot_Gyro_Y,LeftFoot_Gyro_Z,RightFoot_Acc_X,RightFoot_Acc_Y,RightFoot_Acc_Z,RightFoot_Gyro_X,RightFoot_Gyro_Y,RightFoot_Gyro_Z", "tms a:m w:d a:m w:d")
add("M5", "ms,accx,accy,accz,gyrox,gyroy,gyroz", "tms a:g w:d")
add("BerryIMU", "ACCX,ACCY,ACCZ,GYRX,GYRY,GYRZ,MAGX,MAGY,MAGZ,Timestamp", "a:g w:d m:uT Ts")
add("wx wy wz mx T", "#time,ax,ay,az,wx,wy,wz,mx,my,mz,T", "t a:m w:r m:uT tmp")
add("UZH-FPV", "# id timestamp ang_vel_x ang_vel_y ang_vel_z lin_acc_x lin_acc_y lin_acc_z", "i Ts w:r a:m", mark=" ", file="imu.txt")
add("ADVIO gyro", "", "t w:r", file="gyroscope.csv")
add("ADVIO acc", "", "t a:g", file="accelerometer.csv")
add("Zurich RawGyro", "Timestamp, Error_count, x, y, z, temperature, range_rad_s, scaling, x_raw, y_raw, z_raw, temperature_raw", "tus n:0 w:r tmp n:34.9 n:0.001 w:c tmp", file="RawGyro.csv", want="w")
add("Zurich RawAccel", "Timestamp, Error_count, x, y, z, temperature, range_m_s2, scaling, x_raw, y_raw, z_raw, temperature_raw", "tus n:0 a:m tmp n:78.4 n:0.002 a:c tmp", file="RawAccel.csv", want="a")
add("RobotCar ins", "timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,velocity_east,velocity_down,roll,pitch,yaw", "Tus s:INS L n3 s:30U n3 e", refuse="no_sensor")
add("RIDI", "time,gyro_x,gyro_y,gyro_z,acce_x,acce_y,acce_z,linacce_x,linacce_y,linacce_z,grav_x,grav_y,grav_z,magnet_x,magnet_y,magnet_z,ori_w,ori_x,ori_y,ori_z", "tns w:r a:m f:m v:m m:uT q")
add("HHAR", "Index,Arrival_Time,Creation_Time,x,y,z,User,Model,Device,gt", "i Tms Tns a:m s:a s:nexus4 s:nexus4_1 s:stand", file="Phones_accelerometer.csv")
add("HHAR gyro", "Index,Arrival_Time,Creation_Time,x,y,z,User,Model,Device,gt", "i Tms Tns w:r s:a s:nexus4 s:nexus4_1 s:stand", file="Phones_gyroscope.csv")
add("Daphnet", "", "tms a:mg a:mg a:mg n:1", mark=" ", refuse=True, want="a")
add("Blue Trident", "time_s,ax_m/s/s,ay_m/s/s,az_m/s/s,gx_deg/s,gy_deg/s,gz_deg/s,mx_uT,my_uT,mz_uT", "t a:m w:d m:uT")
add("NXP", "Time(s), Acc X (g), Acc Y (g), Acc Z (g), Mag X (uT), Mag Y (uT), Mag Z (uT), Gyro X (dps), Gyro Y (dps), Gyro Z (dps)", "t a:g m:uT w:d")
add("Edge Impulse", "timestamp,accX,accY,accZ,gyrX,gyrY,gyrZ", "tms a:m w:d")
add("OpenBCI", "%OpenBCI Raw EEG Data\n%Number of channels = 2\n%Sample Rate = 100 Hz\n%Board = OpenBCI_GUI$BoardCytonSerial\nSample Index, EXG Channel 0, EXG Channel 1, Accel Channel 0, Accel Channel 1, Accel Channel 2, Other, Timestamp", "i256 n:1.5 n:2.5 a:g n:0 Ts")
add("Muse", "timestamps,X,Y,Z", "Ts a:g", file="ACC_MUSE.csv")
add("Emotiv", "Timestamp,MOT.CounterMems,MOT.InterpolatedMems,MOT.Q0,MOT.Q1,MOT.Q2,MOT.Q3,MOT.AccX,MOT.AccY,MOT.AccZ,MOT.MagX,MOT.MagY,MOT.MagZ", "Ts i256 n:0 q a:g m:uT")
add("Pupil Neon", "section id,recording id,timestamp [ns],gyro x [deg/s],gyro y [deg/s],gyro z [deg/s],acceleration x [g],acceleration y [g],acceleration z [g],roll [deg],pitch [deg],yaw [deg],quaternion w,quaternion x,quaternion y,quaternion z", "s:5b1 s:a22 Tns w:d a:g e q")
add("GoPro accel", '"cts","date","Accelerometer (z) [m/s2]","Accelerometer (x) [m/s2]","Accelerometer (y) [m/s2]","temperature [\u00b0C]"', "tms0 D azxy:m tmp")
add("GoPro gyro", '"cts","date","Gyroscope (z) [rad/s]","Gyroscope (x) [rad/s]","Gyroscope (y) [rad/s]"', "tms0 D wzxy:r")
add("Movella ENU", "PacketCounter,SampleTimeFine,FreeAcc_E,FreeAcc_N,FreeAcc_U,Gyr_X,Gyr_Y,Gyr_Z", "i tus f:m w:d", want="w")
add("Foxglove", "timestamp,header.stamp.sec,header.stamp.nsec,header.frame_id,orientation.x,orientation.y,orientation.z,orientation.w,angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "Ts sec nsec s:imu q w:r a:m")
add("ThingSpeak", "created_at,entry_id,field1,field2,field3", "D i a:m", knows={"columns": {"accel": "2:4"}}, refuse=None, want="a")
add("German Excel", "Zeit [ms];ACC_X [g];ACC_Y [g];ACC_Z [g];GYR_X [\u00b0/s];GYR_Y [\u00b0/s];GYR_Z [\u00b0/s]", "tms a:g w:d", mark=";", edit=lambda line: line.replace(".", ","))
add("SensorConnect", "Time,Node 123:ch1,Node 123:ch2,Node 123:ch3", "D a:g", knows={"columns": {"accel": "1:3"}}, want="a")
add("ZIPPER", "t,Ax1,Ay1,Az1,Gx1,Gy1,Gz1", "t a:g w:d")
add("sensor number first", "time,1_acc_x,1_acc_y,1_acc_z,1_gyro_x,1_gyro_y,1_gyro_z", "t a:g w:d")
add("axis words", "timestamp,accelerometer x-axis,accelerometer y-axis,accelerometer z-axis", "Ts a:m")
add("X acceleration", "Time,X acceleration,Y acceleration,Z acceleration,X rotation rate,Y rotation rate,Z rotation rate", "t a:m w:r")
add("Accel in x", "Time (s),Acceleration in x (m/s/s),Acceleration in y (m/s/s),Acceleration in z (m/s/s)", "t a:m")
add("Ang Rate", "Sample,AngRateX,AngRateY,AngRateZ,AccelX,AccelY,AccelZ,TimeStamp(ms)", "i w:d a:g tms")
add("IMU6", "counter,imu_acc_x,imu_acc_y,imu_acc_z,imu_gyr_x,imu_gyr_y,imu_gyr_z,imu_temp,time", "i256 a:m w:r tmp t")
add("Crazyflie", "timestamp,acc.x,acc.y,acc.z,gyro.x,gyro.y,gyro.z,stabilizer.roll,stabilizer.pitch,stabilizer.yaw", "tms a:g w:d e")
add("Crazyflie range", "timestamp,acc.x,acc.y,acc.z,stateEstimate.x,stateEstimate.y,stateEstimate.z", "tms a:g n3")
add("Unitree", "time,imu_quat_w,imu_quat_x,imu_quat_y,imu_quat_z,imu_gyro_x,imu_gyro_y,imu_gyro_z,imu_acc_x,imu_acc_y,imu_acc_z,foot_force_x,foot_force_y,foot_force_z", "t q w:r a:m n3")
add("Tesla-like dash", "gps_time,lat,lon,speed,accel_lat,accel_long,accel_vert", "Ts n3 n3", refuse=True)
add("RaceBox", "Record,Time,Latitude,Longitude,Altitude,Speed,GForceX,GForceY,GForceZ,Lap,GyroX,GyroY,GyroZ", "i D L p a:g n:1 w:d")
add("Torque OBD", "GPS Time,Device Time,Longitude,Latitude,G(x),G(y),G(z),G(calibrated)", "D D n3 a:g", lines=lambda s: [",".join([m.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3], m.strftime("%Y-%m-%d %H:%M:%S.%f")[:-3], "11.1", "48.2", *(f"{v:.6g}" for v in s["a"][k] / G), "0.01"]) for k, m in enumerate(MOM)], want="a")
add("NMEA mix", "", "", lines=lambda s: [one for k, t in enumerate(T) for one in [f"$IMU,{t:.3f}," + ",".join(f"{v:.5f}" for v in [*s["a"][k], *s["w"][k]]), f"$GPS,{t:.3f},48.1,11.2,500"]], refuse=True)
add("strain gauges", "Time,SG1,SG2,SG3,SG4", "t n3 p", refuse=True)
add("EEG", "time,Fp1,Fp2,C3,C4,O1,O2", "t n3 n3", refuse=True)
add("PMU", "Time,Vx,Vy,Vz,Ix,Iy,Iz", "t n3 n3", refuse=True)
add("three temperatures", "t,temp_x,temp_y,temp_z", "t n3", refuse=True)
add("error of rates", "t,gyro_err_x,gyro_err_y,gyro_err_z", "t n3", refuse=True)
add("desired", "t,acc_des_x,acc_des_y,acc_des_z,acc_x,acc_y,acc_z", "t n3 a:m")
add("kalman", "t,x_hat_0,x_hat_1,x_hat_2", "t n3", refuse=True)
add("world", "t,acc_world_x,acc_world_y,acc_world_z,gyro_x,gyro_y,gyro_z", "t v:m w:r", want="w")
add("magnet position", "t,magnet_pos_x,magnet_pos_y,magnet_pos_z", "t n3", refuse=True)
add("mag with units", "date;time;Bx [nT];By [nT];Bz [nT]", "D2 C m:nT", mark=";")
add("observatory", "DATE TIME DOY BOUX BOUY BOUZ BOUF", "", lines=lambda s: [f"{m:%Y-%m-%d} {m:%H:%M:%S.%f} 121 " + " ".join(f"{v:.2f}" for v in s["m"][k] * 1e9) + f" {np.linalg.norm(s['m'][k]) * 1e9:.2f}" for k, m in enumerate(MOM)], want="m", mark=" ", file="bou.txt", known={"mag": "nT"}, knows={"columns": {"mag": "3:5"}})
# --- further habits: apps, sketches, loggers, drones, vehicles under water, watches, survey and laboratory instruments, other languages
def each(form):
    return lambda s: [form(k, t, s["a"][k], s["w"][k], s["m"][k]) for k, t in enumerate(T)]


def xyz(v, size=1.0, form="{:.5f}", mark=","):
    return mark.join(form.format(x / size) for x in v)


def comma(line):
    return line.replace(".", ",")


# phone apps
add("Sensorstream", "", "", lines=each(lambda k, t, a, w, m: f"{89.5 + t:.5f}, 3, {xyz(a, mark=', ')}, 4, {xyz(w, mark=', ')}, 5, {xyz(m, 1e-6, mark=', ')}"), want="awm")
add("phyphox decimal comma, exponents", '"Time (s)"\t"Acceleration x (m/s^2)"\t"Acceleration y (m/s^2)"\t"Acceleration z (m/s^2)"\t"Absolute acceleration (m/s^2)"', "", lines=each(lambda k, t, a, w, m: comma(f"{t:.9E}\t{xyz(a, form='{:.9E}', mark=chr(9))}\t{np.linalg.norm(a):.9E}")), want="a", mark="\t")
add("Physics Toolbox, all sensors", "time,gFx,gFy,gFz,ax,ay,az,wx,wy,wz,p,Bx,By,Bz,Azimuth,Pitch,Roll,Latitude,Longitude,Speed (m/s)", "t a:g f:m w:r p m:uT e n:48 n:11 n:0")
add("Sensor Logger, wrist", "time,seconds_elapsed,rotationRateX,rotationRateY,rotationRateZ,gravityX,gravityY,gravityZ,accelerationX,accelerationY,accelerationZ,quaternionW,quaternionX,quaternionY,quaternionZ", "Tns t w:r v:g f:g q", want="w", file="WristMotion.csv")
add("VibSensor", "VibSensor Data\nSample Rate (Hz),100\n\nTime (s),X (g),Y (g),Z (g)", "t a:g")
add("RaceChrono", "This file is created using RaceChrono v8.0\nFormat,3\nSession title,x\n\ntimestamp,fragment_id,lap_number,elapsed_time,latitude,longitude,altitude,x_acc,y_acc,z_acc,x_rate_of_rotation,y_rate_of_rotation,z_rate_of_rotation\nunix time,,,s,deg,deg,m,G,G,G,deg/s,deg/s,deg/s\n,,,100: gps,100: gps,100: gps,100: gps,101: acc,101: acc,101: acc,101: gyro,101: gyro,101: gyro", "Ts n:0 n:1 t L a:g w:d")
add("TrackAddict", "# RaceRender Data: TrackAddict 4.9\n# Vehicle App: x\nTime,UTC Time,Lap,GPS_Update,Latitude,Longitude,Altitude (m),Speed (Km/h),Accel X,Accel Y,Accel Z", "t Ts n:0 n:1 L n:0 a:g")
add("Google Science Journal", "timestamp,AccX,AccY,AccZ", "Tms a:m")
add("Sensor Data Collector", "sensor,timestamp,x,y,z", "", lines=lambda s: [one for k, t in enumerate(T) for one in (f"android.sensor.accelerometer,{5e9 + t * 1e9:.0f},{xyz(s['a'][k])}", f"android.sensor.gyroscope,{5e9 + t * 1e9 + 4e5:.0f},{xyz(s['w'][k])}")], want="aw")
add("Sensors Toolbox", "timestamp;accuracy;x;y;z", "tns n:3 a:m", mark=";", file="Accelerometer_20230501.csv")
add("Core Location app", "Time,Motion.RotationRate.X (rad/s),Motion.RotationRate.Y (rad/s),Motion.RotationRate.Z (rad/s),Motion.UserAcceleration.X (G),Motion.UserAcceleration.Y (G),Motion.UserAcceleration.Z (G),Acceleration.X (G),Acceleration.Y (G),Acceleration.Z (G)", "t w:r f:g a:g")
add("Torque, lower case", "Device Time,g(x),g(y),g(z),Speed (OBD)(km/h)", "D a:g n:50")
# sketches and terminals
add("SparkFun ICM-20948", "", "", lines=each(lambda k, t, a, w, m: f"Scaled. Acc (mg) [ {xyz(a, G / 1e3, '{:08.2f}', ', ')} ], Gyr (DPS) [ {xyz(w, DEG, '{:08.3f}', ', ')} ], Mag (uT) [ {xyz(m, 1e-6, '{:08.2f}', ', ')} ], Tmp (C) [ 00025.30 ]"), want="awm", file="log.txt", tolerance=0.01)
add("MPU-6050 sketch", "", "", lines=each(lambda k, t, a, w, m: " | ".join(f"{n} = {v:.0f}" for n, v in zip(["AcX", "AcY", "AcZ", "Tmp", "GyX", "GyY", "GyZ"], [*(a / COUNT["a"]), -3000 + k, *(w / COUNT["w"])], strict=True))), want="aw", file="log.txt", expect="counts")
add("i2cdevlib raw", "", "", lines=each(lambda k, t, a, w, m: "a/g:\t" + xyz([*(a / COUNT["a"]), *(w / COUNT["w"])], form="{:.0f}", mark="\t")), want="aw", file="log.txt", expect="counts", knows={"columns": {"accel": "1:3", "gyro": "4:6"}})
add("i2cdevlib ypr", "", "", lines=each(lambda k, t, a, w, m: f"ypr\t{10 * np.sin(t):.2f}\t{5 * np.cos(t):.2f}\t{3 * np.sin(2 * t):.2f}"), refuse=True, file="log.txt")
add("Adafruit one line", "", "", lines=each(lambda k, t, a, w, m: f"\t\tAccel X: {a[0]:.4f} \tY: {a[1]:.4f} \tZ: {a[2]:.4f} m/s^2 "), want="a", file="log.txt")
add("Adafruit three lines", "", "", lines=lambda s: [one for k in range(N) for one in (f"Acceleration X: {s['a'][k][0]:.4f}, Y: {s['a'][k][1]:.4f}, Z: {s['a'][k][2]:.4f} m/s^2", f"Rotation X: {s['w'][k][0]:.4f}, Y: {s['w'][k][1]:.4f}, Z: {s['w'][k][2]:.4f} rad/s", "Temperature: 25.10 degC", "")], want="aw", file="log.txt")
add("CircuitPython tuples", "", "", lines=each(lambda k, t, a, w, m: f"({xyz(a, mark=', ')})"), want="a", file="log.txt")
add("two tuples", "", "", lines=each(lambda k, t, a, w, m: f"({xyz(a, mark=', ')}) ({xyz(w, mark=', ')})"), want="aw", file="log.txt")
add("serial monitor, no labels", "", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%H:%M:%S.%f}"[:-3] + f" -> {xyz(a)},{xyz(w)}"), want="aw", file="log.txt")
add("PuTTY", "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2023.05.01 11:59:58 =~=~=~=~=~=~=~=~=~=~=~=\nt_ms,ax,ay,az,gx,gy,gz", "tms a:g w:d", file="putty.log")
add("Tera Term", "", "", lines=each(lambda k, t, a, w, m: f"[{MOM[k]:%Y-%m-%d %H:%M:%S.%f}"[:-3] + f"] {xyz(a)},{xyz(w)}"), want="aw", file="teraterm.log")
add("CoolTerm", "", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%d %H:%M:%S.%f}"[:-3] + f"\t{xyz(a)},{xyz(w)}"), want="aw", file="log.txt")
add("Python logging", "", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%d %H:%M:%S},{MOM[k].microsecond // 1000:03d} INFO ax={a[0]:.4f} ay={a[1]:.4f} az={a[2]:.4f} gx={w[0]:.5f} gy={w[1]:.5f} gz={w[2]:.5f}"), want="aw", file="log.txt")
add("units beside the numbers", "time,ax,ay,az", "", lines=each(lambda k, t, a, w, m: f"{t:.2f} s,{xyz(a, G, '{:.5f} g')}"), want="a", refuse="no_rows")
add("serial plotter with limits", "", "", lines=each(lambda k, t, a, w, m: f"Min:-20,Max:20,ax:{a[0]:.4f},ay:{a[1]:.4f},az:{a[2]:.4f}"), want="a", file="log.txt")
add("time in words", "", "", lines=each(lambda k, t, a, w, m: f"Time: {4321 + 1e3 * t:.0f} ms, Acc: [{xyz(a, mark=', ')}], Gyro: [{xyz(w, mark=', ')}]"), want="aw", file="log.txt")
add("ticks of MicroPython", "ticks_ms,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z", "tms a:g w:d")
add("mosquitto", "", "", lines=each(lambda k, t, a, w, m: 'imu/data {"t": %.3f, "ax": %.5f, "ay": %.5f, "az": %.5f}' % (t, *a)), want="a", file="log.txt")
add("header again and again", "t,ax,ay,az", "", lines=each(lambda k, t, a, w, m: ("t,ax,ay,az\n" if k and k % 150 == 0 else "") + f"{t:.3f},{xyz(a)}"), want="a")
# data loggers and files of offices
add("MSR145", "*CREATOR\nMSR SP;V5.12\n*STARTTIME\n2023-05-01;11:59:58;\n*NAME\nMSR\n*CHANNEL\nTIME;ACC x;ACC y;ACC z\n*UNIT\n;G;G;G\n*DATA", "D a:g", mark=";")
add("catman", "Zeit  1 - Standardmessrate\tBeschl X\tBeschl Y\tBeschl Z\ns\tm/s\u00b2\tm/s\u00b2\tm/s\u00b2", "t a:m", mark="\t", edit=comma, file="catman.asc")
add("unit after a comma", '"Time, s","Accel X, m/s2","Accel Y, m/s2","Accel Z, m/s2","Gyro X, deg/s","Gyro Y, deg/s","Gyro Z, deg/s"', "t a:m w:d")
add("unit after a stroke", "t/s;a_x/(m/s\u00b2);a_y/(m/s\u00b2);a_z/(m/s\u00b2);\u03c9_x/(\u00b0/s);\u03c9_y/(\u00b0/s);\u03c9_z/(\u00b0/s)", "t a:m w:d", mark=";", edit=comma)
add("Greek omega", "t,ax,ay,az,\u03c9x,\u03c9y,\u03c9z", "t a:m w:r")
add("names of R", "Time..s.,Acceleration.x..m.s.2.,Acceleration.y..m.s.2.,Acceleration.z..m.s.2.", "t a:m")
add("names of MATLAB", "Time_s_,AccelerationX_m_s_2_,AccelerationY_m_s_2_,AccelerationZ_m_s_2_,GyroscopeX_deg_s_,GyroscopeY_deg_s_,GyroscopeZ_deg_s_", "t a:m w:d")
add("units in words at the end", "timestamp_us,gyro_x_degrees_per_second,gyro_y_degrees_per_second,gyro_z_degrees_per_second,accel_x_milli_g,accel_y_milli_g,accel_z_milli_g,mag_x_microtesla,mag_y_microtesla,mag_z_microtesla", "tus w:d a:mg m:uT")
add("raw and scaled", "t,ax_raw,ay_raw,az_raw,gx_raw,gy_raw,gz_raw,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", "t a:c w:c a:g w:d")
add("units above the names", "s,m/s2,m/s2,m/s2,rad/s,rad/s,rad/s\ntime,ax,ay,az,gx,gy,gz", "t a:m w:r")
add("three lines of header", "Time,Accelerometer,Accelerometer,Accelerometer,Gyroscope,Gyroscope,Gyroscope\n,X,Y,Z,X,Y,Z\n[s],[g],[g],[g],[deg/s],[deg/s],[deg/s]", "t a:g w:d")
add("types below the names", "time,ax,ay,az\nfloat,float,float,float", "t a:m")
add("InfluxDB", "#group,false,false,false,false,false,false\n#datatype,string,long,dateTime:RFC3339,double,double,double\n#default,_result,,,,,\n,result,table,_time,ax,ay,az", "", lines=each(lambda k, t, a, w, m: f",,0,{MOM[k]:%Y-%m-%dT%H:%M:%S.%f}Z,{xyz(a)}"), want="a")
add("Grafana", '"Time","ax","ay","az"', "", lines=each(lambda k, t, a, w, m: f'"{MOM[k]:%Y-%m-%d %H:%M:%S.%f}'[:-3] + f'",{xyz(a)}'), want="a")
add("Grafana, long", '"Series";"Time";"Value"', "", lines=lambda s: [f"ax;{MOM[k]:%Y-%m-%dT%H:%M:%S.%f};{s['a'][k][0]:.5f}" for k in range(N)], refuse=True)
add("dates with decimal commas", "Datum;ax;ay;az", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%d.%m.%Y %H:%M:%S},{MOM[k].microsecond // 1000:03d};" + comma(xyz(a, mark=';'))), want="a")
add("days of a spreadsheet", "Time,ax,ay,az", "", lines=each(lambda k, t, a, w, m: f"{45047.4999 + t / 86400:.10f},{xyz(a)}"), want="a")
add("Julian dates", "JD,mx,my,mz", "", lines=each(lambda k, t, a, w, m: f"{2460065.9999 + t / 86400:.9f},{xyz(m, 1e-9, '{:.2f}')}"), want="m", known={"mag": "nT"}, tolerance=0.01)
add("minutes", "t [min],ax [g],ay [g],az [g]", "", lines=each(lambda k, t, a, w, m: f"{t / 60:.8f},{xyz(a, G)}"), want="a")
add("hours", "Time (h),ax (g),ay (g),az (g)", "", lines=each(lambda k, t, a, w, m: f"{t / 3600:.9f},{xyz(a, G)}"), want="a")
add("ISO with decimal comma and zone", "time;ax;ay;az", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%dT%H:%M:%S},{MOM[k].microsecond // 1000:03d}+02:00;{xyz(a, mark=';')}"), want="a")
add("footer of totals", "time,ax,ay,az", "", lines=lambda s: [f"{t:.3f},{xyz(s['a'][k])}" for k, t in enumerate(T)] + ["", "Total rows: 600", "*** END ***"], want="a")
add("footer of statistics", "time,ax,ay,az", "", lines=lambda s: [f"{t:.3f},{xyz(s['a'][k])}" for k, t in enumerate(T)] + ["Mean,0.1,0.2,9.8", "Std,0.1,0.1,0.1"], want="a")
add("N/A of spreadsheets", "time,ax,ay,az", "", lines=each(lambda k, t, a, w, m: f"{t:.3f}," + ("#N/A,#N/A,#N/A" if k in (200, 201) else xyz(a))), want="a")
add("UTF-16 of Excel", "Time\tAcc X (g)\tAcc Y (g)\tAcc Z (g)", "t a:g", mark="\t", encoding="utf-16", file="log.txt")
add("degrees of Windows", "Zeit;Drehrate X [\u00b0/s];Drehrate Y [\u00b0/s];Drehrate Z [\u00b0/s]", "t w:d", mark=";", encoding="cp1252", edit=comma)
add("blank columns between groups", "t,,ax,ay,az,,gx,gy,gz", "t z a:m z w:r")
# drones, robots, vehicles
add("Tello", "", "", lines=each(lambda k, t, a, w, m: f"pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:63;tof:10;h:0;bat:90;baro:100.12;time:{k // 100};agx:{a[0] * 100:.2f};agy:{a[1] * 100:.2f};agz:{a[2] * 100:.2f};"), want="a", file="log.txt", known={"accel": "cm/s^2"}, tolerance=0.01)
add("PX4 acceleration csv", "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2]", "tus tus a:m", file="log_vehicle_acceleration_0.csv")
add("PX4 angular velocity csv", "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2],xyz_derivative[0],xyz_derivative[1],xyz_derivative[2]", "tus tus w:r n3", file="log_vehicle_angular_velocity_0.csv")
add("Paparazzi", "", "", lines=lambda s: [one for k, t in enumerate(T) for one in (f"{t:.3f} 42 IMU_GYRO {xyz(s['w'][k], mark=' ')}", f"{t:.3f} 42 IMU_ACCEL {xyz(s['a'][k], mark=' ')}")], want="aw", file="log.data")
add("OpenTX", "Date,Time,1RSS(dB),AccX(g),AccY(g),AccZ(g),Ptch(rad),Roll(rad),Yaw(rad)", "D2 C n:-50 a:g e")
add("Blackbox with its header", '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"Data version","2"\n"acc_1G","2048"\n"gyro_scale","0x3f800000"\n"loopIteration","time","axisP[0]","axisP[1]","gyroADC[0]","gyroADC[1]","gyroADC[2]","accSmooth[0]","accSmooth[1]","accSmooth[2]"', "", lines=each(lambda k, t, a, w, m: f"{k},{7e6 + 1e6 * t:.0f},0,0,{xyz(w, DEG, '{:.3f}')},{xyz(a, G / 2048, '{:.0f}')}"), want="aw", tolerance=0.02)
add("AirData", "time(millisecond),datetime(utc),latitude,longitude,altitude(meters), xSpeed(m/s), ySpeed(m/s), zSpeed(m/s), compass_heading(degrees), pitch(degrees), roll(degrees)", "tms D L n3 e", refuse="no_sensor")
add("FlightGear", "Elapsed Time,x-accel-fps_sec,y-accel-fps_sec,z-accel-fps_sec", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{xyz(a, 0.3048)}"), want="a", known={"accel": "0.3048 m/s^2"})
add("VBOX", "File created on 01/05/2023 @ 11:59\n\n[header]\nsatellites\ntime\n\n[column names]\nsats time lat long velocity X_Accel Y_Accel Z_Accel YawRate PitchRate RollRate\n\n[data]", "", lines=each(lambda k, t, a, w, m: f"008 {MOM[k]:%H%M%S}.{MOM[k].microsecond // 10000:02d} +3119.1 -0112.2 000.01 {xyz(a, G, mark=' ')} {xyz(w[::-1], DEG, mark=' ')}"), want="aw", mark=" ", file="run.vbo")
add("MoTeC", '"Format","MoTeC CSV File"\n"Sample Rate","100","Hz"\n\n"Time","G Force Lat","G Force Long","G Force Vert","Steered Angle"\n"s","G","G","G","deg"', "t a:g n:3", refuse=True)
add("AiM", "Time,GPS Speed,InlineAcc,LateralAcc,VerticalAcc,RollRate,PitchRate,YawRate\ns,km/h,g,g,g,deg/s,deg/s,deg/s", "t n:20 f:g w:d", want="w")
add("OxTS", "Time (GPS s),Latitude (deg),Longitude (deg),AccelX (m/s\u00b2),AccelY (m/s\u00b2),AccelZ (m/s\u00b2),AngRateX (deg/s),AngRateY (deg/s),AngRateZ (deg/s),AccelForward (m/s\u00b2),AccelLateral (m/s\u00b2),AccelDown (m/s\u00b2)", "tow n:48 n:11 a:m w:d f:m")
add("u-blox", "iTOW,xAngRate,yAngRate,zAngRate,xAccel,yAccel,zAccel", "", lines=each(lambda k, t, a, w, m: f"{390884000 + 1000 * t:.0f},{xyz(w, DEG)},{xyz(a)}"), want="aw")
add("SBET text", "time,lat,lon,alt,x_vel,y_vel,z_vel,roll,pitch,heading,wander,x_acceleration,y_acceleration,z_acceleration,x_angular_rate,y_angular_rate,z_angular_rate", "tow L n3 e n:0 a:m w:r")
add("ETH rosbag odometry", "t,field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.position.z,field.twist.twist.angular.x,field.twist.twist.angular.y,field.twist.twist.angular.z", "t n3 w:r", refuse=True)
# under water, animals
add("Neptus acceleration", "timestamp (seconds since 01/01/1970), system, entity ,  x (m/s/s), y (m/s/s), z (m/s/s)", "Ts s:lauv s:IMU a:m", file="Acceleration.csv")
add("Neptus rates", "timestamp (seconds since 01/01/1970), system, entity ,  x (rad/s), y (rad/s), z (rad/s)", "Ts s:lauv s:IMU w:r", file="AngularVelocity.csv")
add("MOOS", "", "", lines=lambda s: [f"{t:.3f} IMU_ACCEL_{x} iIMU {s['a'][k][j]:.5f}" for k, t in enumerate(T) for j, x in enumerate("XYZ")], refuse=True, file="x.alog")
add("OceanServer", "", "", lines=each(lambda k, t, a, w, m: f"$C{92 + 5 * np.sin(t):.1f}P{np.cos(t):.1f}R{np.sin(2 * t):.1f}T25.6*2F"), refuse=True, file="log.txt")
add("CATS tag", "Date (UTC),Time (UTC),Accelerometer X [m/s\u00b2],Accelerometer Y [m/s\u00b2],Accelerometer Z [m/s\u00b2],Gyroscope X [mrad/s],Gyroscope Y [mrad/s],Gyroscope Z [mrad/s],Magnetometer X [\u00b5T],Magnetometer Y [\u00b5T],Magnetometer Z [\u00b5T],Temperature (imu) [\u00b0C],Depth (100bar) [m]", "D2 C a:m w:mr m:uT tmp n:12")
add("AxyTrek", "TagID,Timestamp,X,Y,Z,Activity,Depth,Temp. (?C)", "", lines=each(lambda k, t, a, w, m: f"A1,{MOM[k]:%d/%m/%Y %H:%M:%S.%f}"[:-3] + f",{xyz(a, G)},Active,1.2,25.1"), want="a")
add("Daily Diary", "Total Event no.,Acc_x,Acc_y,Acc_z,Mag_x,Mag_y,Mag_z,Temp,Pressure,Hours,Minutes,Seconds", "", lines=each(lambda k, t, a, w, m: f"{k},{xyz(a, G)},{xyz(m, 1e-4)},25.1,1013,{MOM[k].hour},{MOM[k].minute},{MOM[k].second + MOM[k].microsecond / 1e6:.3f}"), want="am")
add("CTD", "timeS,depSM,t090C,c0S/m,sal00", "t p tmp p p", want="")
# watches and worn devices
add("Polar gyroscope", "Phone timestamp;sensor timestamp [ns];X [dps];Y [dps];Z [dps]", "D tns w:d", mark=";", file="Polar_Sense_GYRO.txt")
add("Polar magnetometer", "Phone timestamp;sensor timestamp [ns];X [G];Y [G];Z [G]", "D tns m:G", mark=";", file="Polar_Sense_MAGN.txt")
add("EmbracePlus", "unix_timestamp,x,y,z", "Tus a:c", file="accelerometer.csv", expect="counts")
add("Garmin FIT lists", "timestamp,timestamp_ms,sample_time_offset,accel_x,accel_y,accel_z", "", lines=lambda s: [f"1051000000,{40 * k % 1000},0|10|20|30,{'|'.join(str(int(v)) for v in s['a'][4 * k : 4 * k + 4, 0] * 100)},{'|'.join(str(int(v)) for v in s['a'][4 * k : 4 * k + 4, 1] * 100)},{'|'.join(str(int(v)) for v in s['a'][4 * k : 4 * k + 4, 2] * 100)}" for k in range(N // 4)], refuse=True)
add("Movesense JSON", "", "", lines=lambda s: ['{"data": {"acc": {"Timestamp": %d, "ArrayAcc": [%s]}}}' % (1000 + 40 * k, ", ".join('{"x": %.5f, "y": %.5f, "z": %.5f}' % tuple(s["a"][4 * k + j]) for j in range(4))) for k in range(N // 4)], want="a", file="log.json", refuse=True)
add("Catapult", "Timestamp;Seconds;Velocity;Latitude;Longitude;Heart Rate;acceleration.forward;acceleration.side;acceleration.up;rotation.roll;rotation.pitch;rotation.yaw", "D t n:0 n:48 n:11 n:80 a:g w:d", mark=";", refuse=True)
add("STATSports", "Player Id,Time,Lat,Lon,Speed (m/s),Heart Rate (bpm),Accl X,Accl Y,Accl Z,Gyro X,Gyro Y,Gyro Z", "n:7 D n:48 n:11 n:0 n:80 a:g w:d")
# survey and laboratory instruments
add("borehole", "Time,Gx,Gy,Gz,Bx,By,Bz", "t a:g m:nT")
add("borehole with units", "Time (s),Gx (g),Gy (g),Gz (g),Bx (nT),By (nT),Bz (nT)", "t a:g m:nT")
add("fluxgate", "Time,X (nT),Y (nT),Z (nT),T (nT)", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{xyz(m, 1e-9, '{:.2f}')},{np.linalg.norm(m) * 1e9:.2f}"), want="m")
add("fluxgate in volts", "t,x (V),y (V),z (V)", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{xyz(m, 1e-5)}"), refuse=True)
add("Metrolab", "Time [s],Bx [mT],By [mT],Bz [mT],B [mT]", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{xyz(m, 1e-3, '{:.6f}')},{np.linalg.norm(m) * 1e3:.6f}"), want="m")
add("STIM300", "Time;Gyro X [\u00b0/s];Gyro Y [\u00b0/s];Gyro Z [\u00b0/s];Acc X [g];Acc Y [g];Acc Z [g];Incl X [g];Incl Y [g];Incl Z [g]", "t w:d a:g a:g", mark=";")
add("FOG in deg/h", "Time (s),Rate X (deg/h),Rate Y (deg/h),Rate Z (deg/h)", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{xyz(w, DEG / 3600, '{:.2f}')}"), want="w")
add("rate table beside", "time_s,table_rate_dps,gyro_x_dps,gyro_y_dps,gyro_z_dps", "t n:10 w:d")
add("oscilloscope", "x-axis,1,2,3\nsecond,Volt,Volt,Volt", "t n3", refuse=True)
add("LabJack", "Time,AIN0,AIN1,AIN2", "t n3", refuse=True)
add("Murata", "Time,Rx,Ry,Rz,Ax,Ay,Az", "t w:d a:g", want="a")
add("iSensor counts", "Sample,XGYRO_OUT (LSB),YGYRO_OUT (LSB),ZGYRO_OUT (LSB),XACCL_OUT (LSB),YACCL_OUT (LSB),ZACCL_OUT (LSB)", "i w:c a:c", expect="counts")
add("total field of a proton magnetometer", "time,nT,sq", "", lines=each(lambda k, t, a, w, m: f"{t:.2f},{np.linalg.norm(m) * 1e9:.2f},99"), refuse=True)
add("cave survey, no clock", "accel x,accel y,accel z,mag x,mag y,mag z", "a:g m:uT")
add("tilt meter", "Date,Tilt X (deg),Tilt Y (deg),Temp (C)", "D p p tmp", want="")
add("seismometer", "time,HNX,HNY,HNZ", "t f:m", refuse=True)
# other languages
add("Italian", "Tempo (s);Accelerazione X (m/s\u00b2);Accelerazione Y (m/s\u00b2);Accelerazione Z (m/s\u00b2);Velocit\u00e0 angolare X (rad/s);Velocit\u00e0 angolare Y (rad/s);Velocit\u00e0 angolare Z (rad/s);Campo magnetico X (\u00b5T);Campo magnetico Y (\u00b5T);Campo magnetico Z (\u00b5T)", "t a:m w:r m:uT", mark=";", edit=comma)
add("Portuguese", "Tempo;Acelera\u00e7\u00e3o X;Acelera\u00e7\u00e3o Y;Acelera\u00e7\u00e3o Z;Velocidade angular X;Velocidade angular Y;Velocidade angular Z", "t a:m w:r", mark=";", edit=comma)
add("Dutch", "Tijd;Versnelling X;Versnelling Y;Versnelling Z;Hoeksnelheid X;Hoeksnelheid Y;Hoeksnelheid Z", "t a:m w:r", mark=";", edit=comma)
add("Czech", "\u010cas;Zrychlen\u00ed X;Zrychlen\u00ed Y;Zrychlen\u00ed Z;\u00dahlov\u00e1 rychlost X;\u00dahlov\u00e1 rychlost Y;\u00dahlov\u00e1 rychlost Z", "t a:m w:r", mark=";", edit=comma)
add("Norwegian", "Tid;Akselerasjon X;Akselerasjon Y;Akselerasjon Z;Vinkelhastighet X;Vinkelhastighet Y;Vinkelhastighet Z", "t a:m w:r", mark=";", edit=comma)
add("Hungarian", "Id\u0151;Gyorsul\u00e1s X;Gyorsul\u00e1s Y;Gyorsul\u00e1s Z;Sz\u00f6gsebess\u00e9g X;Sz\u00f6gsebess\u00e9g Y;Sz\u00f6gsebess\u00e9g Z", "t a:m w:r", mark=";", edit=comma)
add("Finnish with units", "Aika (s);Kiihtyvyys X (m/s\u00b2);Kiihtyvyys Y (m/s\u00b2);Kiihtyvyys Z (m/s\u00b2)", "t a:m", mark=";", edit=comma)
add("Russian with units", "\u0412\u0440\u0435\u043c\u044f, \u0441;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435 X, \u043c/\u0441\u00b2;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435 Y, \u043c/\u0441\u00b2;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435 Z, \u043c/\u0441\u00b2", "t a:m", mark=";", edit=comma)
add("Greek", "\u03a7\u03c1\u03cc\u03bd\u03bf\u03c2,\u0395\u03c0\u03b9\u03c4\u03ac\u03c7\u03c5\u03bd\u03c3\u03b7 X,\u0395\u03c0\u03b9\u03c4\u03ac\u03c7\u03c5\u03bd\u03c3\u03b7 Y,\u0395\u03c0\u03b9\u03c4\u03ac\u03c7\u03c5\u03bd\u03c3\u03b7 Z", "t a:m")
add("Korean", "\uc2dc\uac04,\uac00\uc18d\ub3c4 X,\uac00\uc18d\ub3c4 Y,\uac00\uc18d\ub3c4 Z,\uac01\uc18d\ub3c4 X,\uac01\uc18d\ub3c4 Y,\uac01\uc18d\ub3c4 Z,\uc9c0\uc790\uae30 X,\uc9c0\uc790\uae30 Y,\uc9c0\uc790\uae30 Z", "t a:g w:d m:uT")
add("Chinese of Taiwan", "\u6642\u9593(s),\u52a0\u901f\u5ea6X(m/s^2),\u52a0\u901f\u5ea6Y(m/s^2),\u52a0\u901f\u5ea6Z(m/s^2),\u78c1\u5834X(\u03bcT),\u78c1\u5834Y(\u03bcT),\u78c1\u5834Z(\u03bcT)", "t a:m m:uT")
add("Indonesian", "waktu,percepatan_x,percepatan_y,percepatan_z,kecepatan_sudut_x,kecepatan_sudut_y,kecepatan_sudut_z", "t a:m w:r")
add("Romanian", "timp;acceleratie x;acceleratie y;acceleratie z;viteza unghiulara x;viteza unghiulara y;viteza unghiulara z", "t a:m w:r", mark=";", edit=comma)
add("German with units in a line", "Zeit;Beschl. X;Beschl. Y;Beschl. Z;Mag. X;Mag. Y;Mag. Z\nms;mg;mg;mg;\u00b5T;\u00b5T;\u00b5T", "tms a:mg m:uT", mark=";", edit=comma)
add("French of a logger", "Horodatage;Acc_X (g);Acc_Y (g);Acc_Z (g);Gyro_X (\u00b0/s);Gyro_Y (\u00b0/s);Gyro_Z (\u00b0/s)", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%d/%m/%Y %H:%M:%S},{MOM[k].microsecond // 1000:03d};" + comma(f"{xyz(a, G, mark=';')};{xyz(w, DEG, mark=';')}")), want="aw")
add("Spanish of a logger", "Fecha;Hora;Aceleraci\u00f3n X [g];Aceleraci\u00f3n Y [g];Aceleraci\u00f3n Z [g];Velocidad de giro X [\u00b0/s];Velocidad de giro Y [\u00b0/s];Velocidad de giro Z [\u00b0/s]", "D2 C a:g w:d", mark=";", edit=lambda line: line.replace(".", ","))
# --- written after the headers above had been mended
add("Vernier", '"Run 1: Time (s)","Run 1: X-Acceleration (m/s\u00b2)","Run 1: Y-Acceleration (m/s\u00b2)","Run 1: Z-Acceleration (m/s\u00b2)","Run 1: X Gyro (rad/s)","Run 1: Y Gyro (rad/s)","Run 1: Z Gyro (rad/s)"', "t a:m w:r")
add("SPARKvue", "Time (s) Run 1,Acceleration - x (m/s\u00b2) Run 1,Acceleration - y (m/s\u00b2) Run 1,Acceleration - z (m/s\u00b2) Run 1,Angular Velocity - x (rad/s) Run 1,Angular Velocity - y (rad/s) Run 1,Angular Velocity - z (rad/s) Run 1", "t a:m w:r")
add("Logger Pro", "Latest: Time (s)\tLatest: X Acceleration (m/s\u00b2)\tLatest: Y Acceleration (m/s\u00b2)\tLatest: Z Acceleration (m/s\u00b2)", "t a:m", mark="\t", file="Logger.txt")
add("Sense-it", "Timestamp,Accelerometer: x,Accelerometer: y,Accelerometer: z", "tms a:m")
add("two labels, numbers between commas", "", "", lines=each(lambda k, t, a, w, m: f"Accel: {xyz(a, G)} Gyro: {xyz(w, DEG)}"), want="aw", file="log.txt")
add("JSON lines of lists", "", "", lines=each(lambda k, t, a, w, m: '{"ts": %d, "imu": {"acc": [%.5f, %.5f, %.5f], "gyr": [%.5f, %.5f, %.5f]}}' % (1000 + 10 * k, *a, *w)), want="aw", file="log.jsonl")
add("counts named lsb", "time_us;acc_x_lsb;acc_y_lsb;acc_z_lsb;gyr_x_lsb;gyr_y_lsb;gyr_z_lsb", "tus a:c w:c", mark=";", expect="counts")
add("increments without names", "", "", lines=each(lambda k, t, a, w, m: f"{390884 + t:.3f} {xyz(w / RATE, form='{:.9f}', mark=' ')} {xyz(a / RATE, form='{:.9f}', mark=' ')}"), refuse=True, file="imu.txt")
add("WitMotion English", "DeviceName,Time,AccX(g),AccY(g),AccZ(g),AsX(\u00b0/s),AsY(\u00b0/s),AsZ(\u00b0/s),AngleX(\u00b0),AngleY(\u00b0),AngleZ(\u00b0),HX(uT),HY(uT),HZ(uT)", "s:WT901 D a:g w:d e m:uT")
add("Delsys of today", "X [s],Trigno IM sensor 1: Acc 1.X (IM) [g],Trigno IM sensor 1: Acc 1.Y (IM) [g],Trigno IM sensor 1: Acc 1.Z (IM) [g]", "t a:g")
add("OpenSignals", '# OpenSignals Text File Format\n# {"00:07": {"sensor": ["RAW", "RAW", "RAW"], "sampling rate": 100, "column": ["nSeq", "DI", "CH1", "CH2", "CH3"]}}\n# EndOfHeader', "i256 n:0", lines=each(lambda k, t, a, w, m: f"{k % 256}\t0\t{xyz(a / G * 8000 + 32768, form='{:.0f}', mark=chr(9))}"), refuse=True, file="log.txt")
add("PicoScope", "Time,Channel A,Channel B,Channel C\n(ms),(V),(V),(V)\n", "tms0 n3", refuse=True)
add("GRAPHTEC", "Number,Date&Time,ms,CH1,CH2,CH3\nNO.,Time,ms,g,g,g", "", lines=each(lambda k, t, a, w, m: f"{k + 1},{MOM[k]:%Y/%m/%d %H:%M:%S},{MOM[k].microsecond // 1000},{xyz(a, G)}"), want="a")
add("PCE", "Nr.;Date;Time;Acc. X [g];Acc. Y [g];Acc. Z [g];Temp. [\u00b0C]", "i D2 C a:g tmp", mark=";", edit=lambda line: line.replace(".", ","))
add("Blue Raven", "Flight_Time_(s),Sync,Gyro_X,Gyro_Y,Gyro_Z,Accel_X,Accel_Y,Accel_Z,Quat_1,Quat_2,Quat_3,Quat_4", "t n:0 w:d a:g q")
add("AltOS", "#version,serial,flight,call,time,clock,rssi,lqi,state,state_name,acceleration,pressure,altitude,height,accel_x,accel_y,accel_z,gyro_roll,gyro_pitch,gyro_yaw,mag_x,mag_y,mag_z", "n:13 n:1 n:1 s:N0CALL t n:0 n:0 n:0 n:2 s:boost n:0 p n:100 n:0 a:m w:d m:G")
add("CubeSat", "TIME,B_X_nT,B_Y_nT,B_Z_nT,OMEGA_X_degps,OMEGA_Y_degps,OMEGA_Z_degps", "Ts m:nT w:d")
add("RAW_IMU", "timestamp,RAW_IMU.time_usec,RAW_IMU.xacc,RAW_IMU.yacc,RAW_IMU.zacc,RAW_IMU.xgyro,RAW_IMU.ygyro,RAW_IMU.zgyro,RAW_IMU.xmag,RAW_IMU.ymag,RAW_IMU.zmag", "Ts tus a:mg w:mr m:mG")
add("MRU", "Time;Roll;Pitch;Heave;Heading", "t p p p p", mark=";", refuse=True)
add("wave buoy", "Time;heave (m);north (m);west (m)", "t n3", mark=";", refuse=True)
add("watch in mg", "ts;x;y;z", "", lines=each(lambda k, t, a, w, m: f"{E0 * 1000 + round(1e3 * t)};{xyz(a, G / 1e3, '{:.0f}', ';')}"), want="a", tolerance=0.01)
add("HealthKit", "type,sourceName,startDate,value", "", lines=each(lambda k, t, a, w, m: f"HKQuantityTypeIdentifierHeartRate,Watch,{MOM[k]:%Y-%m-%d %H:%M:%S} +0200,{60 + k % 7}"), refuse=True)
add("Japanese axes", "\u6642\u523b,\u52a0\u901f\u5ea6X\u8ef8(m/s\u00b2),\u52a0\u901f\u5ea6Y\u8ef8(m/s\u00b2),\u52a0\u901f\u5ea6Z\u8ef8(m/s\u00b2),\u30b8\u30e3\u30a4\u30edX\u8ef8(deg/s),\u30b8\u30e3\u30a4\u30edY\u8ef8(deg/s),\u30b8\u30e3\u30a4\u30edZ\u8ef8(deg/s),\u5730\u78c1\u6c17X\u8ef8(uT),\u5730\u78c1\u6c17Y\u8ef8(uT),\u5730\u78c1\u6c17Z\u8ef8(uT)", "t a:m w:d m:uT")
add("Slovak", "\u010cas;Zr\u00fdchlenie X;Zr\u00fdchlenie Y;Zr\u00fdchlenie Z;Uhlov\u00e1 r\u00fdchlos\u0165 X;Uhlov\u00e1 r\u00fdchlos\u0165 Y;Uhlov\u00e1 r\u00fdchlos\u0165 Z", "t a:m w:r", mark=";", edit=comma)
add("Croatian with units", "Vrijeme [s];Ubrzanje X [m/s2];Ubrzanje Y [m/s2];Ubrzanje Z [m/s2];Kutna brzina X [rad/s];Kutna brzina Y [rad/s];Kutna brzina Z [rad/s]", "t a:m w:r", mark=";", edit=comma)
add("Danish", "Tid;Acceleration X;Acceleration Y;Acceleration Z;Vinkelhastighed X;Vinkelhastighed Y;Vinkelhastighed Z", "t a:m w:r", mark=";", edit=comma)
add("Vietnamese", "Th\u1eddi gian;Gia t\u1ed1c X;Gia t\u1ed1c Y;Gia t\u1ed1c Z;V\u1eadn t\u1ed1c g\u00f3c X;V\u1eadn t\u1ed1c g\u00f3c Y;V\u1eadn t\u1ed1c g\u00f3c Z", "t a:m w:r", mark=";")
add("Ukrainian", "\u0427\u0430\u0441;\u041f\u0440\u0438\u0441\u043a\u043e\u0440\u0435\u043d\u043d\u044f X;\u041f\u0440\u0438\u0441\u043a\u043e\u0440\u0435\u043d\u043d\u044f Y;\u041f\u0440\u0438\u0441\u043a\u043e\u0440\u0435\u043d\u043d\u044f Z", "t a:m", mark=";", edit=comma)
add("pipes", "time|ax|ay|az|gx|gy|gz", "t a:g w:d", mark="|")
add("Octave", "# Created by Octave 8.4.0\n# name: data\n# type: matrix\n# rows: 600\n# columns: 7", "", lines=each(lambda k, t, a, w, m: f" {t:.3f} {xyz(w, mark=' ')} {xyz(a, mark=' ')}"), want="aw", file="data.txt")
add("savetxt with names", "# t ax ay az gx gy gz", "", lines=each(lambda k, t, a, w, m: f"{t:.18e} {xyz(a, form='{:.18e}', mark=' ')} {xyz(w, form='{:.18e}', mark=' ')}"), want="aw", file="data.txt")
add("write.table of R", '"t" "ax" "ay" "az"', "", lines=each(lambda k, t, a, w, m: f'"{k + 1}" {t:.3f} {xyz(a, mark=" ")}'), want="a", mark=" ", file="data.txt")
add("tuples of pandas", "\"('time', '')\",\"('acc', 'x')\",\"('acc', 'y')\",\"('acc', 'z')\",\"('gyr', 'x')\",\"('gyr', 'y')\",\"('gyr', 'z')\"", "t a:m w:r")
add("INSERT INTO", "", "", lines=each(lambda k, t, a, w, m: f"INSERT INTO imu VALUES ({k},{t:.3f},{xyz(a)});"), refuse=True, file="dump.sql")
add("BNO085", "timestamp_us,accel_x,accel_y,accel_z,lin_accel_x,lin_accel_y,lin_accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,quat_i,quat_j,quat_k,quat_real", "tus a:m f:m w:r m:uT q")
add("dual rate", "t,hi_acc_x,hi_acc_y,hi_acc_z,lo_acc_x,lo_acc_y,lo_acc_z", "t a:g a:g")
add("Teensy", "micros(),AcX,AcY,AcZ,GyX,GyY,GyZ", "tus a:g w:d")
add("magnetometer of an observatory, columns", "Date Time X(nT) Y(nT) Z(nT) F(nT)", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%d-%m-%Y %H:%M:%S.%f}"[:-3] + f" {xyz(m, 1e-9, '{:.2f}', ' ')} {np.linalg.norm(m) * 1e9:.2f}"), want="m", mark=" ", file="obs.txt")
add("rate gyro single axis", "Time (s),Yaw rate (deg/s)", "", lines=each(lambda k, t, a, w, m: f"{t:.3f},{w[2] / DEG:.5f}"), refuse=True)
add("IMU named by place", "Time,IMU_Pelvis_AccX,IMU_Pelvis_AccY,IMU_Pelvis_AccZ,IMU_Pelvis_GyroX,IMU_Pelvis_GyroY,IMU_Pelvis_GyroZ", "t a:m w:d")
add("g-force of a game", "Time,GForceLateral,GForceLongitudinal,GForceVertical", "t f:g", refuse=True)
# --- and after these: phones, sketches, loggers, robots, autopilots, surveys, wearables, boats, cars and published data sets
add("Sensor Logger TotalAcceleration", "time,seconds_elapsed,z,y,x", "Tns t azyx:m", file="TotalAcceleration.csv")
add("Sensor Logger Gyroscope", "time,seconds_elapsed,z,y,x", "Tns t wzyx:r", file="Gyroscope.csv")
add("Sensor Logger Gravity", "time,seconds_elapsed,z,y,x", "Tns t v:m", file="Gravity.csv", refuse=True)
add("Sensor Logger Orientation", "time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw", "Tns t q e", file="Orientation.csv", refuse=True)
add("phyphox Magnetometer of a zip", '"Time (s)","X (\u00b5T)","Y (\u00b5T)","Z (\u00b5T)"', "t m:uT", file="Magnetometer.csv")
add("phyphox Linear Accelerometer", '"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"', "t f:m", file="Linear Accelerometer.csv", refuse=True)
add("AndroSensor, all", "ACCELEROMETER X (m/s\u00b2),ACCELEROMETER Y (m/s\u00b2),ACCELEROMETER Z (m/s\u00b2),GYROSCOPE X (rad/s),GYROSCOPE Y (rad/s),GYROSCOPE Z (rad/s),LIGHT (lux),MAGNETIC FIELD X (\u03bcT),MAGNETIC FIELD Y (\u03bcT),MAGNETIC FIELD Z (\u03bcT),ORIENTATION Z (azimuth \u00b0),ORIENTATION X (pitch \u00b0),ORIENTATION Y (roll \u00b0),PROXIMITY (i),ATMOSPHERIC PRESSURE (hPa),SOUND LEVEL (dB),Time since start in ms ,YYYY-MO-DD HH-MI-SS_SSS", "a:m w:r n:120 m:uT e n:5 p n:0.1 tms D")
add("Physics Toolbox g-force meter", "time,gFx,gFy,gFz,TgF", "t a:g norm:g")
add("Physics Toolbox gyroscope", "time,wx,wy,wz", "t w:r", file="2023-05-01_gyroscope.csv")
add("Physics Toolbox linear", "time,ax,ay,az,aT", "t f:m n:0.3", refuse=True)
add("Sensor Record", "Timestamp,Milliseconds,X,Y,Z", "D tms0 a:m", file="Accelerometer.csv")
add("Core Motion logger", "Timestamp,AccelX,AccelY,AccelZ,RotX,RotY,RotZ,Roll,Pitch,Yaw", "Ts a:g w:r e")
add("watch DeviceMotion", "timestamp,attitudeRoll,attitudePitch,attitudeYaw,rotationRateX,rotationRateY,rotationRateZ,gravityX,gravityY,gravityZ,userAccelerationX,userAccelerationY,userAccelerationZ", "Ts e w:r v:g f:g", want="w")
add("MotionSense", ",attitude.roll,attitude.pitch,attitude.yaw,gravity.x,gravity.y,gravity.z,rotationRate.x,rotationRate.y,rotationRate.z,userAcceleration.x,userAcceleration.y,userAcceleration.z", "i e v:g w:r f:g", want="w", file="sub_1.csv")
add("sketch with a greeting", "Accelerometer sample rate = 100.00Hz\n\nGyroscope sample rate = 100.00Hz\n", "tms a:g w:d", file="putty.log", knows={"columns": {"time": 0, "accel": "1:3", "gyro": "4:6"}})
add("sketch of raw counts, time last", "", "a:c w:c tms", expect="counts", file="COM3.txt", knows={"columns": {"accel": "0:2", "gyro": "3:5", "time": 6}})
add("Nano magnetometer", "t_ms\tmag_x\tmag_y\tmag_z", "tms m:uT", mark="\t", file="log.txt")
add("HMC5883L of Adafruit", "", "", lines=each(lambda k, t, a, w, m: "X: {:.2f}  Y: {:.2f}  Z: {:.2f}  uT".format(*m / 1e-6)), want="m", file="log.txt")
add("QMC5883L counts", "", "", lines=each(lambda k, t, a, w, m: "X: {:.0f} Y: {:.0f} Z: {:.0f}".format(*m / 0.15e-6)), want="m", file="qmc5883.txt", known={"mag": "0.15 uT"}, tolerance=0.01, knows={"columns": {"mag": "0:2"}})
add("MPU9250 of Winer", "", "", lines=each(lambda k, t, a, w, m: "X-acceleration: {:.2f} mg Y-acceleration: {:.2f} mg Z-acceleration: {:.2f} mg\nX-gyro rate: {:.3f} degrees/sec Y-gyro rate: {:.3f} degrees/sec Z-gyro rate: {:.3f} degrees/sec".format(*a / G * 1e3, *w / DEG)), want="aw", file="log.txt")
add("key and list", "", "", lines=each(lambda k, t, a, w, m: f"t={1000 + 10 * k} acc={xyz(a)} gyr={xyz(w)}"), want="aw", file="log.txt")
add("JSON lines of a sketch", "", "", lines=each(lambda k, t, a, w, m: '{"t":%d,"a":{"x":%.4f,"y":%.4f,"z":%.4f},"g":{"x":%.5f,"y":%.5f,"z":%.5f}}' % (1000 + 10 * k, *a, *w)), want="aw", file="log.jsonl")
add("Teleplot", "", "", lines=each(lambda k, t, a, w, m: "\n".join(f">a{x}:{1000 + 10 * k}:{v:.4f}" for x, v in zip("xyz", a, strict=True))), want="a", file="log.txt")
add("Serial Plot channels", "timestamp,Channel 1,Channel 2,Channel 3", "t a:m")
add("serial plotter labels", "", "", lines=each(lambda k, t, a, w, m: "ax:{:.3f},ay:{:.3f},az:{:.3f},gx:{:.3f},gy:{:.3f},gz:{:.3f}".format(*a / G, *w / DEG)), want="aw", file="log.txt")
add("clock in brackets", "", "", lines=each(lambda k, t, a, w, m: f"[{MOM[k]:%H:%M:%S.%f}"[:-3] + f"] {xyz(a, mark=' ')}"), want="a", file="log.txt")
add("Razor M0", "timeMS,accelX,accelY,accelZ,gyroX,gyroY,gyroZ,magX,magY,magZ", "tms a:g w:d m:uT")
add("BenchVue volts", "Scan,Time,101 <AccX> (VDC),102 <AccY> (VDC),103 <AccZ> (VDC)", "i D n3", refuse=True)
add("34970A with alarms", "Scan,Time,101 (g),Alarm 101,102 (g),Alarm 102,103 (g),Alarm 103", "", lines=each(lambda k, t, a, w, m: f"{k + 1},{MOM[k]:%m/%d/%Y %H:%M:%S:%f}"[:-3] + "".join(f",{v / G:.5f},0" for v in a)), want="a", knows={"columns": {"accel": "2,4,6"}})
add("FlexLogger", "Log Rate:,100\nTime,Acceleration X (g),Acceleration Y (g),Acceleration Z (g)", "D a:g")
add("SignalExpress", "channel names:\nAccX\tAccY\tAccZ\nstart times:\n5/1/2023 11:59:58.0\t5/1/2023 11:59:58.0\t5/1/2023 11:59:58.0\ndt:\n0.010000\t0.010000\t0.010000\ndata:", "a:g", mark="\t", file="log.txt")
add("WinDaq", '"Relative Time","X (g)","Y (g)","Z (g)"', "t a:g")
add("Hioki volts", '"Time[s]","CH1-1[V]","CH1-2[V]","CH1-3[V]"', "t n3", refuse=True)
add("FAMOS", "Time;Acc_x;Acc_y;Acc_z\ns;m/s^2;m/s^2;m/s^2", "t a:m", mark=";", edit=comma)
add("Testlab", "Time\tAcc:+X\tAcc:+Y\tAcc:+Z\ns\tg\tg\tg", "t a:g", mark="\t", file="log.txt")
add("HOBO of today", '"#","Date-Time (CET)","X-Axis Acceleration (g)","Y-Axis Acceleration (g)","Z-Axis Acceleration (g)"', "i D a:g")
add("MadgeTech", "Date,Time,X Axis Acceleration (g),Y Axis Acceleration (g),Z Axis Acceleration (g)", "Du C a:g")
add("Bosch XDK", "sys_tick[ms]; lgt[milliLux]; bma280_x[mg]; bma280_y[mg]; bma280_z[mg]; bmg160_x[mDeg]; bmg160_y[mDeg]; bmg160_z[mDeg]; bmm150_x[uT]; bmm150_y[uT]; bmm150_z[uT]", "tms n:100 a:mg w:md m:uT", mark=";")
add("SensorTag", "time,acc_x (G),acc_y (G),acc_z (G),gyro_x (\u00b0/s),gyro_y (\u00b0/s),gyro_z (\u00b0/s),mag_x (uT),mag_y (uT),mag_z (uT)", "t a:g w:d m:uT")
add("PicoQuake", "# PLab PicoQuake Data\n# Time: 2024-04-21 15:54:46.333682, Device: D4E9 (E6632891E36F2029)\n# Num. samples: 600, Duration: 6.0 s\n# Config: data_rate = 100.0 Hz, filter = 42 Hz, acc_range = 4 g, gyro_range = 250.0 dps\n# Integrity: True, Skipped samples: 0\ncount,t,a_x,a_y,a_z,g_x,g_y,g_z", "i t a:g w:d")
add("ROS 2 flattened", "header.stamp.sec,header.stamp.nanosec,header.frame_id,orientation.x,orientation.y,orientation.z,orientation.w,angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "sec nsec s:imu_link q w:r a:m")
add("rosbags-dataframe", ",angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "D w:r a:m")
add("legged robot", "t,imu.gyro.0,imu.gyro.1,imu.gyro.2,imu.accel.0,imu.accel.1,imu.accel.2,imu.quat.0,imu.quat.1,imu.quat.2,imu.quat.3", "t w:r a:m q")
add("MuJoCo", "time,framequat_0,framequat_1,framequat_2,framequat_3,gyro_0,gyro_1,gyro_2,accelerometer_0,accelerometer_1,accelerometer_2", "t q w:r a:m")
add("TUM VI", "# timestamp[ns] wx wy wz ax ay az", "Tns w:r a:m", mark=" ", file="imu.txt")
add("Hilti", "timestamp,omega.x,omega.y,omega.z,acc.x,acc.y,acc.z", "Ts w:r a:m")
add("KAIST Urban", "", "Tns q e w:r a:m m:G", file="xsens_imu.csv", knows={"columns": {"time": 0, "gyro": "8,9,10", "accel": "11,12,13", "mag": "14,15,16"}, "units": {"mag": "G"}})
add("vehicle_imu of PX4", "timestamp,timestamp_sample,accel_device_id,gyro_device_id,delta_angle[0],delta_angle[1],delta_angle[2],delta_velocity[0],delta_velocity[1],delta_velocity[2],delta_angle_dt,delta_velocity_dt", "", lines=each(lambda k, t, a, w, m: f"{7000000 + 10000 * k},{7000000 + 10000 * k},2818058,2818058,{xyz(w / RATE, form='{:.9f}')},{xyz(a / RATE, form='{:.9f}')},10000,10000"), want="wa")
add("barometer of PX4", "timestamp,timestamp_sample,device_id,pressure,temperature,error_count", "tus tus n:4028433 p tmp n:0", want="", file="log_0_sensor_baro_0.csv")
add("IMU of ArduPilot", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", "tus n:0 w:r a:m n:0 n:0 tmp n:1 n:1 n:1000 n:1000")
add("MAG of ArduPilot", "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S", "tus n:0 m:mG n:12 n:-30 n:5 n:0 n:0 n:0 n:1 tus")
add("LibrePilot", "timestamp,GyroState.x,GyroState.y,GyroState.z,AccelState.x,AccelState.y,AccelState.z", "tms w:d a:m")
add("Applanix", "GPS Time (s)\tOmega X (deg/s)\tOmega Y (deg/s)\tOmega Z (deg/s)\tAcc X (m/s2)\tAcc Y (m/s2)\tAcc Z (m/s2)", "tow w:d a:m", mark="\t", file="imu.txt")
add("Inertial Explorer", "UTCTime Latitude Longitude H-Ell Roll Pitch Heading VEast VNorth VUp", "tow L e n3", mark=" ", file="traj.txt", refuse=True)
add("MagArrow", "Counter,Date,Time,Latitude,Longitude,Mag,MagValid,CompassX,CompassY,CompassZ,GyroscopeX,GyroscopeY,GyroscopeZ,AccelerometerX,AccelerometerY,AccelerometerZ,ImuTemperature", "i Du C n:37.4 n:-122.1 n:48123.4 n:1 m:uT w:d a:g tmp")
add("MagDrone", "Timestamp [ms];B1x [nT];B1y [nT];B1z [nT];B2x [nT];B2y [nT];B2z [nT];AccX [g];AccY [g];AccZ [g];Temp [Degree];Latitude [Decimal Degrees];Longitude [Decimal Degrees]", "tms m:nT m:nT a:g tmp n:48.1 n:11.2", mark=";")
add("Spectramag", "Time (s)\tX (nT)\tY (nT)\tZ (nT)", "t m:nT", mark="\t", file="run.dat")
add("Shimmer, two accelerometers", "Shimmer_5AC1_Timestamp_Unix_CAL\tShimmer_5AC1_Accel_LN_X_CAL\tShimmer_5AC1_Accel_LN_Y_CAL\tShimmer_5AC1_Accel_LN_Z_CAL\tShimmer_5AC1_Accel_WR_X_CAL\tShimmer_5AC1_Accel_WR_Y_CAL\tShimmer_5AC1_Accel_WR_Z_CAL\tShimmer_5AC1_Battery_CAL\tShimmer_5AC1_Gyro_X_CAL\tShimmer_5AC1_Gyro_Y_CAL\tShimmer_5AC1_Gyro_Z_CAL\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tm/(s^2)\tm/(s^2)\tm/(s^2)\tmV\tdeg/s\tdeg/s\tdeg/s", "Tms a:m a:m n:4012.5 w:d", mark="\t")
add("pygt3x", "Timestamp,X,Y,Z", "Ts a:g", file="TAS1H30182785_RAW.csv")
add("Axivity AX6", "Time,Accel-X (g),Accel-Y (g),Accel-Z (g),Gyro-X (d/s),Gyro-Y (d/s),Gyro-Z (d/s),Light,Temperature", "D a:g w:d n:12 tmp")
add("Movesense gyro", "timestamp,x,y,z", "tms w:d", file="Movesense_Gyro_174630000123.csv")
add("Movesense IMU9", "Timestamp(ms),AccX,AccY,AccZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ", "tms a:m w:d m:uT")
add("Polar PPG", "Phone timestamp;sensor timestamp [ns];channel 0;channel 1;channel 2;ambient", "D tns k k k k", mark=";", refuse=True, file="Polar_Sense_PPG.txt")
add("MetaWear quaternion", "epoch (ms),timestamp (+0000),elapsed (s),w (number),x (number),y (number),z (number)", "Tms D t q", file="MetaWear_Quaternion.csv", refuse=True)
add("IMeasureU", "timestamp,ax_m/s/s,ay_m/s/s,az_m/s/s,gx_deg/s,gy_deg/s,gz_deg/s,mx_uT,my_uT,mz_uT", "t a:m w:d m:uT")
add("Cometa", "Time [s];EMG1 [uV];ACC1 X [g];ACC1 Y [g];ACC1 Z [g];GYR1 X [dps];GYR1 Y [dps];GYR1 Z [dps]", "t k a:g w:d", mark=";")
add("CASAS watch", "stamp,yaw,pitch,roll,rotation_rate_x,rotation_rate_y,rotation_rate_z,user_acceleration_x,user_acceleration_y,user_acceleration_z", "D e w:r f:g", want="w")
add("Maka Niu", "", "", lines=each(lambda k, t, a, w, m: (f"BATT:{161753520979 + 10**7 * k}\t20230501\t{MOM[k]:%H%M%S}.{MOM[k].microsecond // 1000:03d}\t12.1\n" if k % 100 == 50 else "") + f"IMUN:{161753520979 + 10**7 * k}\t20230501\t{MOM[k]:%H%M%S}.{MOM[k].microsecond // 1000:03d}\t{xyz(a, G, mark=chr(9))}\t{xyz(w, DEG, mark=chr(9))}\t{xyz(m, 1e-6, mark=chr(9))}\t24.5"), want="awm", file="log.txt", knows={"columns": {"accel": "3:5", "gyro": "6:8", "mag": "9:11"}})
add("Sparton", "Time (ms),Accel X (mg),Accel Y (mg),Accel Z (mg),Gyro X (rad/s),Gyro Y (rad/s),Gyro Z (rad/s),Mag X (mGauss),Mag Y (mGauss),Mag Z (mGauss)", "tms a:mg w:r m:mG")
add("glider", "m_present_time m_roll m_pitch m_heading m_depth", "Ts p p p p", mark=" ", file="unit.txt", refuse=True)
add("wave buoy displacement", "year,month,day,hour,min,sec,milisec,x (m),y (m),z (m)", "", lines=each(lambda k, t, a, w, m: f"2023,5,1,{MOM[k].hour},{MOM[k].minute},{MOM[k].second},{MOM[k].microsecond // 1000},{np.sin(t):.3f},{np.cos(t):.3f},{0.4 * np.sin(2 * t):.3f}"), refuse=True, file="displacement.csv")
add("whale tag", "Ax,Ay,Az,Mx,My,Mz,Depth,Temp", "a:g m:uT p tmp")
add("signals of MDF", "timestamps,LongAcc,LatAcc,YawRate,VehSpd", "t n3 p", refuse=True)
add("CANoe", "Time[s];ESP_Laengsbeschl[m/s2];ESP_Querbeschleunigung[g];ESP_Gierrate[deg/s]", "t n3", mark=";", edit=comma, refuse=True)
add("IMU04", "time,X_Accel (g),Y_Accel (g),Z_Accel (g),PitchRate (deg/s),RollRate (deg/s),YawRate (deg/s)", "t a:g wyxz:d")
add("frames of a bus", "TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;DataBytes", "", lines=each(lambda k, t, a, w, m: f"{E0 + t:.6f};1;1DA;0;8;8;0;0;0;{k * 7919 % 2**32:08X}00000000"), refuse=True)
add("CANedge signals", "t,AccelerationX,AccelerationY,AccelerationZ,AngularRateX,AngularRateY,AngularRateZ", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%d %H:%M:%S.%f}+00:00,{xyz(a)},{xyz(w, DEG)}"), want="aw")
add("openpilot", "t,accelerometer.acceleration.v[0],accelerometer.acceleration.v[1],accelerometer.acceleration.v[2],gyroscope.gyroUncalibrated.v[0],gyroscope.gyroUncalibrated.v[1],gyroscope.gyroUncalibrated.v[2]", "t a:m w:r")
add("PVS", "timestamp,acc_x_dashboard,acc_y_dashboard,acc_z_dashboard,acc_x_above_suspension,acc_y_above_suspension,acc_z_above_suspension,gyro_x_dashboard,gyro_y_dashboard,gyro_z_dashboard,mag_x_dashboard,mag_y_dashboard,mag_z_dashboard,temp_dashboard,timestamp_gps,latitude,longitude,speed", "Ts a:m a:m w:d m:uT tmp Ts n:-27.7 n:-51.1 n:0.009")
add("driving behaviour", "AccX,AccY,AccZ,GyroX,GyroY,GyroZ,Class,Timestamp", "f:m w:r s:NORMAL I", want="w")
add("WISDM", "", "", lines=each(lambda k, t, a, w, m: f"1600,A,{252207666810782 + 10**7 * k},{xyz(a)};"), want="a", file="data_1600_accel_phone.txt")
add("RealWorld", "id,attr_time,attr_x,attr_y,attr_z", "i Tms a:m", file="acc_walking_shin.csv")
add("ExtraSensory", "", "Ts a:g", mark=" ", file="1444079161.m_raw_acc.dat")
add("HuGaDB", "#Activity\twalking\n#ActivityID\t1\n#Date\t05-01-11-59\nRF_acc_x\tRF_acc_y\tRF_acc_z\tRF_gyro_x\tRF_gyro_y\tRF_gyro_z\tact", "a:c w:c n:1", mark="\t", file="HuGaDB_v1_walking_01_00.txt", expect="counts")
add("LTMM", "v-acceleration,ml-acceleration,ap-acceleration,yaw-velocity,pitch-velocity,roll-velocity", "a:g wzyx:d", given={"rate": 100})
add("freezing of gait", "Time,AccV,AccML,AccAP,StartHesitation,Turn,Walking", "i a:g n:0 n:0 n:0", knows={"columns": {"accel": "1,2,3"}})
add("cows", "TimeStamp_UNIX,TimeStamp_JST,AccX,AccY,AccZ,Label", "Ts D a:g s:RES")
add("stamps of minutes", "time_stamp,x,y,z,sitting,standing,walking,grazing", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%d-%m-%Y %H:%M},{xyz(a, G)},0,0,1,0"), want="a")
add("quadcopter deliveries", "time,wind_speed,wind_angle,battery_voltage,battery_current,position_x,position_y,position_z,orientation_x,orientation_y,orientation_z,orientation_w,velocity_x,velocity_y,velocity_z,angular_x,angular_y,angular_z,linear_acceleration_x,linear_acceleration_y,linear_acceleration_z", "t p p p p n3 q n3 w:r a:m")
add("CareerCon", "row_id,series_id,measurement_number,orientation_X,orientation_Y,orientation_Z,orientation_W,angular_velocity_X,angular_velocity_Y,angular_velocity_Z,linear_acceleration_X,linear_acceleration_Y,linear_acceleration_Z", "s:0_0 n:0 i q w:r a:m")
add("SUTD", "accx,accy,accz,grax,gray,graz,gyrx,gyry,gyrz,lacx,lacy,lacz,magx,magy,magz,rotx,roty,rotz,rote", "a:m v:m w:r f:m m:uT q")
# --- and after these
add("Sense HAT of a school", "Date,Time,temp_h,temp_p,humidity,pressure,pitch,roll,yaw,mag_x,mag_y,mag_z,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z", "D2 C tmp tmp p p e m:uT a:g w:r")
add("Pico logger", "Timestamp,AccelerationX,AccelerationY,AccelerationZ,GyroscopeX,GyroscopeY,GyroscopeZ,TemperatureC", "tms a:g w:d tmp")
add("CubeMX stream", "tick;acc_x_mg;acc_y_mg;acc_z_mg;gyro_x_mdps;gyro_y_mdps;gyro_z_mdps", "tms a:mg w:md", mark=";")
add("ST MEMS Studio", "timestamp[us]\tA_x[mg]\tA_y[mg]\tA_z[mg]\tG_x[mdps]\tG_y[mdps]\tG_z[mdps]\tM_x[mgauss]\tM_y[mgauss]\tM_z[mgauss]", "tus a:mg w:md m:mG", mark="\t", file="log.txt")
add("TDK Motion Link", "time(s),accel_x(g),accel_y(g),accel_z(g),gyro_x(dps),gyro_y(dps),gyro_z(dps),temp(degC)", "t a:g w:d tmp")
add("Ellipse with dates", "UTC Date\tUTC Time\tAccelerometer X\tAccelerometer Y\tAccelerometer Z\tGyroscope X\tGyroscope Y\tGyroscope Z\n(yyyy-mm-dd)\t(hh:mm:ss)\t(m/s\u00b2)\t(m/s\u00b2)\t(m/s\u00b2)\t(\u00b0/s)\t(\u00b0/s)\t(\u00b0/s)", "D2 C a:m w:d", mark="\t", file="log.txt")
add("Xsens MTw", "PacketCounter,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,UTC_Nano,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second", "", lines=each(lambda k, t, a, w, m: f"{k},{xyz(a)},{xyz(w)},{MOM[k].microsecond * 1000},2023,5,1,{MOM[k].hour},{MOM[k].minute},{MOM[k].second}"), want="aw")
add("orientation of an IMU", "timestamp,roll_deg,pitch_deg,yaw_deg,roll_rate_dps,pitch_rate_dps,yaw_rate_dps", "t e w:d")
add("ship motion", "time;roll rate [deg/s];pitch rate [deg/s];yaw rate [deg/s];surge acc [m/s2];sway acc [m/s2];heave acc [m/s2]", "t w:d a:m", mark=";")
add("vehicle dynamics", "t_s,ax_mps2,ay_mps2,az_mps2,p_radps,q_radps,r_radps,v_kph", "t a:m w:r p")
add("simulink", "time,ax_meas,ay_meas,az_meas,wx_meas,wy_meas,wz_meas,ax_true,ay_true,az_true", "t a:m w:r a:m")
add("rocket", "T+ (s),Accel X (g),Accel Y (g),Accel Z (g),Gyro X (dps),Gyro Y (dps),Gyro Z (dps),Baro Alt (ft)", "t a:g w:d p")
add("tilt and rate", "time_ms,angX,angY,angZ,gyroX,gyroY,gyroZ", "tms e w:d")
add("compass sketch", "millis,headingDeg,magX_uT,magY_uT,magZ_uT", "tms p m:uT")
add("Hall sensor on a stage", "Position_mm,Bx_mT,By_mT,Bz_mT", "n3", lines=each(lambda k, t, a, w, m: f"{0.1 * k:.1f},{1 + t:.4f},{2 - t:.4f},{0.5 * t:.4f}"), refuse=True)
add("smart shoe", "ts,L_ax,L_ay,L_az,L_gx,L_gy,L_gz,L_p1,L_p2,L_p3", "tms a:m w:d k k k")
add("two watches", "time,acc_left_x,acc_left_y,acc_left_z,acc_right_x,acc_right_y,acc_right_z", "t a:g a:g")
add("bees", "datetime,hive,x_accel,y_accel,z_accel,weight", "D s:A a:g p")
add("elevator", "Time (s),Vertical acceleration (m/s\u00b2),Lateral X (m/s\u00b2),Lateral Y (m/s\u00b2)", "t n3", refuse=True)
add("drum of a washing machine", "t[ms];acc1_x[g];acc1_y[g];acc1_z[g];acc2_x[g];acc2_y[g];acc2_z[g];rpm", "tms a:g a:g k", mark=";", edit=comma)
add("bridge", "DATE;TIME;CH1_X (mg);CH1_Y (mg);CH1_Z (mg)", "D2 C a:mg", mark=";")
add("seismic station in counts", "time,HNE,HNN,HNZ", "Ts n3", refuse=True)
add("UWB and IMU", "timestamp,range_a0,range_a1,range_a2,ax,ay,az,gx,gy,gz", "t n3 a:m w:r")
add("VR headset", "time,pos_x,pos_y,pos_z,rot_x,rot_y,rot_z,rot_w,vel_x,vel_y,vel_z,angVel_x,angVel_y,angVel_z", "t n3 q n3 w:r")
add("joystick", "time,x,y,z,buttons", "t n3 k", refuse=True)
add("GNSS antenna", "GPS_Time,East_m,North_m,Up_m,Qe,Qn,Qu", "tow n3 n3", refuse=True)
add("Allan set of a student", "Sample,GyroX_raw,GyroY_raw,GyroZ_raw,Temp_raw", "i w:c n:-2400", known={"gyro": f"{1 / 131:.12g} deg/s"})
add("quaternion and rates", "t,qw,qx,qy,qz,omega_x,omega_y,omega_z", "t q w:r")
add("calibrated beside raw", "time,raw_ax,raw_ay,raw_az,cal_ax,cal_ay,cal_az", "t a:m a:m")
add("nT of a satellite", "UTC,BX_nT,BY_nT,BZ_nT,B_nT", "D m:nT n:48000")
# --- headers that programs in public repositories write, and those of further makers
add("gyro rig", "Timestamp,Accel_X,Accel_Y,Accel_Z,Temperature,outer_encoder,inner_encoder,outer_rpm,inner_rpm,payload_rpm", "D a:m tmp k k p p p")
add("cloud", "timestamp,accelx,accely,accelz", "D a:g")
add("rocket MS5607", "TIME,AX,AY,AZ,GX,GY,GZ,MX,MY,MZ,T,P", "tms a:m w:d m:uT tmp p")
add("mahony", "# You can now move/rotate the board\n# Pipe this output to visualize_live.py for live visualization\n#\ntime,ax,ay,az,gx,gy,gz,mx,my,mz,qw,qx,qy,qz,roll,pitch,yaw", "tms a:m w:r m:uT q e")
add("mpuTemp", "time,ax,ay,az,gx,gy,gz,mpuTemp,bmeTemp,altitude,pressure,humidity", "tms a:m w:r tmp tmp p p p")
add("between temperature", "time,Ax,Ay,Az,Temperature_mpu,Gx,Gy,Gz,Temperature_bme,Pressure,Altitude,Humidity", "tms a:g tmp w:d tmp p p p")
add("filtered beside", "time,ax,ay,az,gx,gy,gz,filterAx,filterAy,filterAz,totalAccel,smoothAccel", "tms a:g w:d f:g norm:g norm:g")
add("proximity", "time,aX,aY,aZ,proximity", "tms a:g k")
add("piezo counts", "ESP32_READY\nRECORDING_START\ntime,ax,ay,az,gx,gy,gz,piezo", "tms a:c w:c k", expect="counts")
add("RTC", "timestamp,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,temp_c", "D a:m w:r tmp")
add("Adafruit event", "Timestamp,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ", "tms a:m w:r")
add("roll pitch heading", "Timestamp,AccelX,AccelY,AccelZ,Roll,Pitch,Heading,Temp,Pressure,Altitude,Lat,Long", "tms a:m e tmp p p n:48 n:11")
add("satellites", "Timestamp,Accel_X,Accel_Y,Accel_Z,Gyro_X,Gyro_Y,Gyro_Z,Mag_X,Mag_Y,Mag_Z,Latitude,Longitude,Altitude_MSL,Satellites", "D a:m w:d m:uT n:48 n:11 p n:9")
add("MQTT", "counter,capture_time_ms,recorded_at_time_ms,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,yaw,pitch,roll,device_id", "I Tms Tms a:m w:d m:uT e s:edge-1")
add("Android", "timestamp,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,rotation_x,rotation_y,rotation_z,rotation_w,latitude,longitude,altitude,gps_speed,gps_accuracy", "Tms a:m w:r m:uT q L p p")
add("cansat flags", "timestamp,mode,lat,lon,alt_gps,alt_press,pressure,gps_valid,press_valid,rssi,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,imu_temp,imu_valid,voltage,current,power,power_valid", "tms n:2 L p p n:1 n:1 n:-70 a:m w:r m:uT tmp n:1 n:3.7 n:0.2 n:0.7 n:1")
add("ground station", "timestamp,altitude,pressure,temperature,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,gps_lat,gps_lon,gps_alt,gps_satellites,state,packet_num,ground_rssi", "t p p tmp a:m w:r m:uT L n:0 s:PAD i n:-85")
add("SYNC lines", "", "", lines=each(lambda k, t, a, w, m: f"SYNC,{k},{7000 + 10 * k},3,410,40.1,22.5,{xyz(a)},{xyz(w, DEG)},{xyz(m, 1e-6)},1.1,2.2,3.3"), file="log.txt", want="awm", refuse=None, knows={"columns": {"time": 2, "accel": "7:9", "gyro": "10:12", "mag": "13:15"}})
add("Turkish", "ivmeX,ivmeY,ivmeZ,GyroX,GyroY,GyroZ,A0,A1", "a:m w:d k k")
add("legacy", "epoch_ms,elapsed_ms,sensor,x,y,z", "", lines=lambda s: [one for k, t in enumerate(T) for one in (f"{E0 * 1000 + 10 * k},{10 * k},ACC,{xyz(s['a'][k])}", f"{E0 * 1000 + 10 * k},{10 * k},GYRO,{xyz(s['w'][k], DEG)}")], want="aw")
add("Xsens DOT utc", "PacketCounter,SampleTimeFine,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,elapsed_ms,utc_timestamp", "I tus e a:m w:d tms D")
add("delsys names", "X[s],EMG 1 [V],ACCX1 [g],ACCY1 [g],ACCZ1 [g],GyroX1 [deg/s],GyroY1 [deg/s],GyroZ1 [deg/s]", "t p a:g w:d")
add("German ROS", "Zeitstempel,Orientation_X,Orientation_Y,Orientation_Z,Orientation_W,Lineare_Beschleunigung_X,Lineare_Beschleunigung_Y,Lineare_Beschleunigung_Z,Winkelgeschwinigkeit_X,Winkelgeschwinigkeit_Y,Winkelgeschwinigkeit_z", "Ts q a:m w:r")
add("German throw", "id;wurf_id;zeitpunkt;sequenz_nr;beschleunigung_x;beschleunigung_y;beschleunigung_z;gyroskop_x;gyroskop_y;gyroskop_z;magnetometer_x;magnetometer_y;magnetometer_z", "s:a1 s:w7 D i a:m w:d m:uT", mark=";")
add("Spanish seismograph", "hora_sistema,aceleracion_x,aceleracion_y,aceleracion_z", "C a:m")
add("Spanish ESP32", "fecha,dispositivo,aceleracion_x,aceleracion_y,aceleracion_z,giroscopio_x,giroscopio_y,giroscopio_z,temperatura", "D s:esp32-1 a:m w:r tmp")
add("us in brackets", "timestamp(us),acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "Tus a:m w:r")
add("capture frames", "frame,timestamp_utc,cam1_image,cam2_image,fot_cm,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "i D s:a.jpg s:b.jpg n:3 a:m w:r")
add("Empatica dataset", "datetime,acc_x,acc_y,acc_z", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%d %H:%M:%S.%f},{a[0] / G * 64:.0f}.0,{a[1] / G * 64:.0f}.0,{a[2] / G * 64:.0f}.0"), want="a", file="ACC_016.csv", known={"accel": "0.015625 g"}, tolerance=0.02)
add("two accelerometers", "MET [sec],Flag,Flag,Flag,Flag,Volt [V],Curr [A],AccelX,AccelY,AccelZ,Temp[C],AccelX,AccelY,AccelZ,BMXTemp,GyroX,GyroY,GyroZ,MagX,MagY,MagZ,Hall", "t n:0 n:1 n:0 n:0 n:3.7 n:0.2 a:m tmp a:m tmp w:d m:uT n:3")
add("battery mic", "DateTime,BatteryV,Microphone,TempC,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ", "D n:3.71 k tmp a:g w:d")
add("web motion", "label,timestamp,accelX,accelY,accelZ,gyroAlpha,gyroBeta,gyroGamma", "s:walk Tms a:m wzxy:d")
add("iOS Grav", "Time,GyroX,GyroY,GyroZ,GravX,GravY,GravZ,AccelX,AccelY,AccelZ", "t w:r v:g f:g", want="w")
add("Catalyst", "Time(us),Altitude(m),Latitude,Longitude,GyroX,GyroY,GyroZ,AccelX,AccelY,AccelZ,AttitudeX,AttitudeY,AttitudeZ,state", "tus p n:48 n:11 w:d a:m e n:2")
add("formula car", "TIME,TPS,OIL_PRES,ACCELX,ACCELY,ACCELZ,STRAIN1,STRAIN2,PTUBE1,GYROX,GYROY,GYROZ,MAGNETX,MAGNETY,MAGNETZ,DAQTEMP", "tms p p a:g k k p w:d m:uT tmp")
add("IMU: lines", "", "", lines=each(lambda k, t, a, w, m: f"IMU:{xyz(a, G, '{:.4f}')},{xyz(w, DEG, '{:.3f}')},0.01,0.02,1.1,2.2"), file="log.txt", want="aw", refuse=None, known={}, knows={"columns": {"accel": "0:2", "gyro": "3:5"}})
add("patient", "sessionID,patientID,startTime,numberOfSensors,sensorName,sensorPosition,timeStamp,accX,accY,accZ,gyroX,gyroY,gyroZ,magX,magY,magZ", "n:4 n:17 s:2023-05-01 n:1 s:MetaMotion s:shank Tms a:g w:d m:uT")
add("Chinese mg", "Timestamp,Roll,Pitch,Yaw,AccX,AccY,AccZ,GyroX,GyroY,GyroZ", "tms e a:mg w:d")
add("samples of a Pico", "Sample,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ,Roll,Pitch", "i a:g w:d p p")
add("TempC GForce", "AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ,TempC,GForce", "a:m w:r tmp norm:g")
add("units below iOS", "TimeStamp,Lattitude,Longitude,Altitude,HorizontalAccuracy,VerticalAccuracy,Speed,Course,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ\ntime,degrees,degrees,meters,meters,meters,mps,degrees,g,g,g,rad/s,rad/s,rad/s", "t L n:5 n:5 p p a:g w:r")
add("BNO085 2", "time_ms,time_utc,acceleration_x,acceleration_y,acceleration_z,acceleration_t,angular_velocity_x,angular_velocity_y,angular_velocity_z,angular_velocity_t,linear_acceleration_x,linear_acceleration_y,linear_acceleration_z,linear_acceleration_t,gravity_x,gravity_y,gravity_z,gravity_t,orientation_i,orientation_j,orientation_k,orientation_real,orientation_t,longitude", "tms C a:m tms w:r tms f:m tms v:m tms q tms n:11")
add("ROS 2 record", "# topic=/imu\n# frequency_hz=100\nreceive_time_ns,ros_stamp_sec,ros_stamp_nanosec,quaternion_w,quaternion_x,quaternion_y,quaternion_z,quaternion_norm,angular_velocity_x,angular_velocity_y,angular_velocity_z,linear_acceleration_x,linear_acceleration_y,linear_acceleration_z,arrival_gap_ms", "Tns sec nsec q n:1.0 w:r a:m n:10.0")
add("recv msg", "recv_time,msg_time,orientation_x,orientation_y,orientation_z,orientation_w,angular_velocity_x,angular_velocity_y,angular_velocity_z,linear_acceleration_x,linear_acceleration_y,linear_acceleration_z", "Ts Ts q w:r a:m")
add("Baja", "ms;rpm;vel;tCVT;vBat;pTras;tBat;perT;perF;pedF;pDiant;estrc;accX;accY;accZ;vLF;vRF;corrDif", "tms k p p n:12.4 p p n:0 n:0 n:0 p n:0 a:g p p n:0", mark=";")
add("drone log head", "Time;GPS Lock;Lat;;Lon;;Alt;Speed;Track angle;HDOP;GG;AccX;AccY;AccZ;GyroX;GyroY;GyroZ;MagX;MagY;MagZ;Baro;Voltage;Current;mAh;T1;T2;T3", "tms n:1 n:48 s:N n:11 s:E p p p n:1.1 n:0 a:g w:d m:uT p n:11.1 n:2 n:300 tmp tmp tmp", mark=";")
add("wisdm copy", ";timestamp;accX;accY;accZ;username", "i Tms a:m s:m1", mark=";")
add("CanSat rot", "tempCanSat;humCanSat;pressCanSat;altCanSat;accX;accY;accZ;rotX;rotY;rotZ;magX;magY;magZ;year;month;day;hour;minute;second", "", lines=each(lambda k, t, a, w, m: f"25.1;40;1013.2;120;{xyz(a, mark=';')};{xyz(w, DEG, mark=';')};{xyz(m, 1e-6, mark=';')};2023;5;1;{MOM[k].hour};{MOM[k].minute};{MOM[k].second + MOM[k].microsecond / 1e6:.3f}"), want="awm")
add("power", "Time,Cpu_temperature(C),Cpu_load(%),Voltage(V),Current(mA),Power(W),Accel_x(m/s2),Accel_y(m/s2),Accel_z(m/s2),Gyro_x(rad/s),Gyro_y(rad/s),Gyro_z(rad/s)", "D tmp p n:5.1 p p a:m w:r")
add("magnitude", "Time_s,Accel_X(m/s\u00b2),Accel_Y(m/s\u00b2),Accel_Z(m/s\u00b2),Magnitude(m/s\u00b2)", "t a:m norm:m", encoding="cp1252")
add("robot text", "#timestamp accel_x(m/s^2) accel_y(m/s^2) accel_z(m/s^2) gyro_x(rad/s) gyro_y(rad/s) gyro_z(rad/s)", "Ts a:m w:r", mark=" ", file="imu_data.txt")
add("three timestamps", "Log_Timestamp(ms),IMU_Timestamp(ms),Accel_X(m/s^2),Accel_Y(m/s^2),Accel_Z(m/s^2),Gyro_X(rad/s),Gyro_Y(rad/s),Gyro_Z(rad/s),Baro_Timestamp(ms),Pressure(hPa),Temperature(C),Altitude(m)", "tms tms a:m w:r tms p tmp p")
add("total(g)", "Timestamp(ms),Acc_X(g),Acc_Y(g),Acc_Z(g),Acc_Total(g),Gyro_X(deg/s),Gyro_Y(deg/s),Gyro_Z(deg/s),Pitch(deg),Roll(deg)", "Tms a:g norm:g w:d p p")
add("GPS clock parts", "Timestamp_ms,GPS_Year,GPS_Month,GPS_Day,GPS_Hour,GPS_Min,GPS_Sec,Time_Valid,Accel_X(G),Accel_Y(G),Accel_Z(G),Gyro_X(deg/s),Gyro_Y(deg/s),Gyro_Z(deg/s),Baro_Altitude(m),Latitude,Longitude,GPS_Altitude(m),PDOP,Fix_Type,Satellites", "", lines=each(lambda k, t, a, w, m: f"{4321 + 10 * k},2023,5,1,{MOM[k].hour},{MOM[k].minute},{MOM[k].second},1,{xyz(a, G)},{xyz(w, DEG)},120.1,48.1,11.2,500,1.1,3,9"), want="aw")
add("comment as header", "# Start: 2023-05-01 11:59:58\n# Port: COM3, Baudrate: 115200\n# Format: timestamp(s), roll(deg), pitch(deg), yaw(deg), q0, q1, q2, q3, acc_x(g), acc_y(g), acc_z(g), gyro_x(deg/s), gyro_y(deg/s), gyro_z(deg/s), mag_x, mag_y, mag_z, temp(C)", "Ts e q a:g w:d m:uT tmp")
add("French patient", "Time(s),Timestamp,PatientID,Activity,Acc_X(g),Acc_Y(g),Acc_Z(g),Gyro_X(deg/s),Gyro_Y(deg/s),Gyro_Z(deg/s),HeartRate(BPM),Intensity(G)", "t C s:P01 s:marche a:g w:d n:71 norm:g")
add("tabs and PID", "time(ms)\tgyro_x(deg/s)\tgyro_y(deg/s)\tgyro_z(deg/s)\torientation_roll(deg)\torientation_pitch(deg)\torientation_yaw(deg)\tthrottle\tbattery(V)\tloop_time(uS)", "tms w:d e p n:11.1 n:2500", mark="\t", file="flight.txt")
add("MicroPython SD", "Time(s),Temp(C),Pressure(hPa),Altitude_BMP(m),Accel_X(g),Accel_Y(g),Accel_Z(g),Gyro_X(deg/s),Gyro_Y(deg/s),Gyro_Z(deg/s),GPS_Lat,GPS_Lon,GPS_Alt(m),Satellites", "t tmp p p a:g w:d L n:7")
add("PPPLib", "GPS_week GPS_Wos Acce_x(m/s^2) Acce_y(m/s^2) Acce_z(m/s^2) Gyro_x(deg/s) Gyro_y(deg/s) Gyro_z(deg/s)", "week tow a:m w:d", mark=" ", file="imu.txt")
add("gpsd", "fix,time,lat,lon,gps_alt,baro_alt,press,temp,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z", "s:3D Ts L p p tmp a:m w:d m:uT")
add("tick_ms counts", "frame_id,tick_ms,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z", "i tms a:c w:c", file="LSM_IMU.CSV", expect="counts")
add("raw of QMA", "frame_id,tick_ms,raw_x,raw_y,raw_z", "i tms a:c", file="QMA_ACC.CSV", expect="counts")
add("Movesense desktop", "timestamp_ms,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z,roll,pitch,yaw,qw,qx,qy,qz,temperature,air_pressure", "tms a:m w:r m:uT e q tmp p")
add("unit suffix datetime", "elapsed_s,datetime,accel_x_ms2,accel_y_ms2,accel_z_ms2,gyro_x_rads,gyro_y_rads,gyro_z_rads,mag_x_uT,mag_y_uT,mag_z_uT,quat_i,quat_j,quat_k,quat_real,calibration_status", "t D a:m w:r m:uT q n:3")
add("firmware replay", "timestamp_seconds,pressure_pa,temperature_c,imu_accel_x_g,imu_accel_y_g,imu_accel_z_g,imu_gyro_x_dps,imu_gyro_y_dps,imu_gyro_z_dps,mag_x_ut,mag_y_ut,mag_z_ut", "t p tmp a:g w:d m:uT")
add("mcutime", "mcutime_ms,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT,motor_a_measured_rate_rpm", "tms w:r a:m m:uT k")
add("table stage", "host_timestamp_iso,host_time_monotonic_s,frame_idx,raw_serial_line,serial_time_us,raw_mag_x_uT,raw_mag_y_uT,raw_mag_z_uT,raw_acc_x,raw_acc_y,raw_acc_z,raw_gyr_x,raw_gyr_y,raw_gyr_z", "D t i s:abc tus m:uT a:m w:d")
add("driver phone", "t,phone_accel_x_mps2,phone_accel_y_mps2,phone_accel_z_mps2,phone_gyro_x_radps,phone_gyro_y_radps,phone_gyro_z_radps,phone_mag_x_uT,phone_mag_y_uT,phone_mag_z_uT", "t a:m w:r m:uT")
add("EuRoC names", "#timestamp [ns],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2]", "Tns w:r a:m")
add("homework text", "time [sec], gyro_x [rad/s], gyro_y [rad/s], gyro_z [rad/s], accel_x [m/s^2], accel_y [m/s^2], accel_z [m/s^2]", "t w:r a:m")
add("insta360", "t_s,ts_us,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "t tus a:g w:r")
add("Russian units", "\u0432\u0440\u0435\u043c\u044f[\u0441]\t\u041a\u0440\u0435\u043d[\u0433\u0440\u0430\u0434]\t\u0422\u0430\u043d\u0433\u0430\u0436[\u0433\u0440\u0430\u0434]\t\u041a\u0443\u0440\u0441[\u0433\u0440\u0430\u0434]\t\u0423\u0433\u043b.\u0441\u043a\u043e\u0440_x[\u0433\u0440\u0430\u0434/\u0441]\t\u0423\u0433\u043b.\u0441\u043a\u043e\u0440_y[\u0433\u0440\u0430\u0434/\u0441]\t\u0423\u0433\u043b.\u0441\u043a\u043e\u0440_z[\u0433\u0440\u0430\u0434/\u0441]\t\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_x[\u043c/\u0441/\u0441]\t\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_y[\u043c/\u0441/\u0441]\t\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_z[\u043c/\u0441/\u0441]\t\u0422\u0435\u043c\u043f\u0435\u0440\u0430\u0442\u0443\u0440\u0430[\u0433\u0440\u0430\u0434.\u0426\u0435\u043b\u044c\u0441\u0438\u044f]", "t e w:d a:m tmp", mark="\t", file="imu.txt")
add("Russian database", "ID_\u0437\u0430\u043f\u0438\u0441\u0438;\u0414\u0430\u0442\u0430_\u0432\u0440\u0435\u043c\u044f;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_X;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_Y;\u0423\u0441\u043a\u043e\u0440\u0435\u043d\u0438\u0435_Z", "i D a:m", mark=";")
add("Russian short", "\u0432\u0440\u0435\u043c\u044f_\u0441;\u0443\u0441\u043a\u043e\u0440_x;\u0443\u0441\u043a\u043e\u0440_y;\u0443\u0441\u043a\u043e\u0440_z", "t a:m", mark=";", edit=comma, encoding="cp1251")
add("Chinese web", "\u65f6\u95f4\u6233,\u5149\u5f3a,\u52a0\u901f\u5ea6X,\u52a0\u901f\u5ea6Y,\u52a0\u901f\u5ea6Z,\u89d2\u901f\u5ea6X,\u89d2\u901f\u5ea6Y,\u89d2\u901f\u5ea6Z,\u7ecf\u5ea6,\u7eac\u5ea6", "Tms k a:g w:d n:116.3 n:39.9")
add("Chinese device", "\u65f6\u95f4,\u8bbe\u5907\u540d\u79f0,\u7247\u4e0a\u65f6\u95f4(),\u52a0\u901f\u5ea6X(g),\u52a0\u901f\u5ea6Y(g),\u52a0\u901f\u5ea6Z(g),\u89d2\u901f\u5ea6X(\u00b0/s),\u89d2\u901f\u5ea6Y(\u00b0/s),\u89d2\u901f\u5ea6Z(\u00b0/s),\u89d2\u5ea6X(\u00b0),\u89d2\u5ea6Y(\u00b0),\u89d2\u5ea6Z(\u00b0),\u78c1\u573aX(ut),\u78c1\u573aY(ut),\u78c1\u573aZ(ut),\u6e29\u5ea6(\u2103),\u56db\u5143\u65700(),\u56db\u5143\u65701(),\u56db\u5143\u65702(),\u56db\u5143\u65703()", "D s:WT901 D a:g w:d e m:uT tmp q")
add("Chinese packets", "\u5305\u5e8f\u53f7,\u52a0\u901f\u5ea6X,\u52a0\u901f\u5ea6Y,\u52a0\u901f\u5ea6Z,\u89d2\u901f\u5ea6X,\u89d2\u901f\u5ea6Y,\u89d2\u901f\u5ea6Z", "i a:g w:d", encoding="gb2312")
add("Chinese sequence", "\u5e8f\u5217\u53f7,\u65f6\u95f4\u6233,\u52a0\u901f\u5ea6X,\u52a0\u901f\u5ea6Y,\u52a0\u901f\u5ea6Z,\u9640\u87ba\u4eeaX,\u9640\u87ba\u4eeaY,\u9640\u87ba\u4eeaZ,\u6e29\u5ea6", "i tms a:g w:d tmp")
add("Chinese epoch", "epoch_ms,\u52a0\u901f\u5ea6X(g),\u52a0\u901f\u5ea6Y(g),\u52a0\u901f\u5ea6Z(g),\u89d2\u901f\u5ea6X(\u00b0/s),\u89d2\u901f\u5ea6Y(\u00b0/s),\u89d2\u901f\u5ea6Z(\u00b0/s)", "Tms a:g w:d")
add("Chinese columns of a JY901", "\u5f00\u59cb\u65f6\u95f4\uff1a2023-05-01 11:59:58\n  \u52a0\u901f\u5ea6X\uff1a \u52a0\u901f\u5ea6Y\uff1a \u52a0\u901f\u5ea6Z\uff1a  \u89d2\u901f\u5ea6X\uff1a \u89d2\u901f\u5ea6Y\uff1a \u89d2\u901f\u5ea6Z\uff1a", "", lines=each(lambda k, t, a, w, m: f"  {xyz(a, G, '{:.4f}', '   ')}   {xyz(w, DEG, '{:.4f}', '   ')}"), want="aw", file="data.txt", known={})
add("Japanese node", "\u52a0\u901f\u5ea6x,\u52a0\u901f\u5ea6y,\u52a0\u901f\u5ea6z,\u30b8\u30e3\u30a4\u30edx,\u30b8\u30e3\u30a4\u30edy,\u30b8\u30e3\u30a4\u30edz,\u78c1\u6c17x,\u78c1\u6c17y,\u78c1\u6c17z,", "a:g w:d m:uT z")
add("Spanish sketch", "Tiempo,Ax,Ay,Az,Gx,Gy,Gz", "tms a:g w:d")
add("French sketch", "Temps;Acceleration_X;Acceleration_Y;Acceleration_Z;Vitesse_X;Vitesse_Y;Vitesse_Z", "tms a:m w:r", mark=";")
add("French NAO", "Temps;Mag_X;Mag_Y;Mag_Z", "t m:uT", mark=";", file="mnet.csv")
add("training car", "timestamp,gps_lat,gps_lon,gps_speed_ms,gps_heading,imu_accel_x,imu_accel_y,imu_accel_z,imu_gyro_x,imu_gyro_y,imu_gyro_z,encoder_pos,evento", "Ts n:48 n:11 p p a:m w:d k s:-")
add("battery car", "time,counter,IMU_Accel_x,IMU_Accel_y,IMU_Accel_z,IMU_Gyro_x,IMU_Gyro_y,IMU_Gyro_z,Battery_1,Battery_2,Brake_Pedal", "t i a:g w:d p p n:0")
add("flight computer", "millis(),Current_state,Calculated_flight_time,Time_since_last_log,IMU_accel_X,IMU_accel_Y,IMU_accel_Z,IMU_mag_X,IMU_mag_Y,IMU_mag_Z,IMU_gyro_X,IMU_gyro_Y,IMU_gyro_Z", "tms n:1 t n:10 a:m m:uT w:d")
add("absaccel", "nav_errorflag,nav_uptime,imu_accel_x,imu_accel_y,imu_accel_z,imu_gyro_x,imu_gyro_y,imu_gyro_z,imu_absaccel,imu_temp,baro_pressure", "n:0 tms a:m w:d norm:m tmp p")
add("watch research", "time_s,epoch_s,userAccelerationX,userAccelerationY,userAccelerationZ,gravityX,gravityY,gravityZ,rotationRateX,rotationRateY,rotationRateZ,attitude_qW,attitude_qX,attitude_qY,attitude_qZ", "t Ts f:g v:g w:r q", want="w")
add("relativeTime", "index,timestamp,relativeTime,attitudeRoll,attitudePitch,attitudeYaw,rotationRateX,rotationRateY,rotationRateZ,gravityX,gravityY,gravityZ,userAccX,userAccY,userAccZ", "i Ts t e w:r v:g f:g", want="w")
add("watch German", "timestamp,elapsed,pitch,yaw,roll,rotationRateX,rotationRateY,rotationRateZ,userAccelX,userAccelY,userAccelZ,gravityAccelX,gravityAccelY,gravityAccelZ,accelerationX,accelerationY,accelerationZ", "D t e w:r f:g v:g a:g")
add("Duration(us)", "Duration(\u00b5s),Timestamp(\u00b5s),AccelerationX,AccelerationY,AccelerationZ,RotationRateX,RotationRateY,RotationRateZ,VelocityX,VelocityY,VelocityZ,PositionX,PositionY,PositionZ,Distance", "n:10000 tus a:g w:r n3 n3 p")
add("iPhone all", "motionTimestamp,accelerationX,accelerationY,accelerationZ,rotationRateX,rotationRateY,rotationRateZ,magneticFieldAccuracy,magneticFieldX,magneticFieldY,magneticFieldZ,gravityX,gravityY,gravityZ", "t a:g w:r n:2 m:uT v:g")
add("CubeSat drop", "Time,ACCx,ACCy,ACCz,GYRx,GYRy,GYRz,MAGx,MAGy,MAGz", "t a:g w:d m:uT", file="CubeSat_Drop.txt")
add("micro:bit log", "Time,AccX,AccY,AccZ,MagX,MagY,MagZ,Heading,Gesture", "tms a:mg m:nT p s:up")
add("trailing comma", "t,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ,", "t a:m w:r m:uT z")
add("Finnish", "datetime,t_ms,TempC,Press_hPa,AltRel_m,AccX,AccY,AccZ,GyrX,GyrY,GyrZ,MagX_u,MagY_u,MagZ_u,Head_deg", "D tms tmp p p a:g w:d m:uT p")
add("S and E", "S,PRESSURE_HPA,TEMP_DEG_C,ACCx,ACCy,ACCz,GYRx,GYRy,GYRz,LAT,LONG,E", "s:S p tmp a:g w:d n:48 n:11 s:E")
add("JINS MEME", "time,count,AccX,AccY,AccZ,GyrX,GyrY,GyrZ,EogL,EogR,EogH,EogV", "Ts i256 a:c w:c k k k k", expect="counts")
add("Edge Impulse 2", "timestamp,accX,accY,accZ,gyrX,gyrY,gyrZ", "tms0 a:m w:d")
add("activity", "Timestamp,Activity,AccX,AccY,AccZ,GyrX,GyrY,GyrZ", "Tms s:WALKING a:m w:r")
add("Unity", "accX,accY,accZ,gyrX,gyrY,gyrZ,cmpX,cmpY,cmpZ,fr1,fr2,fr3,time", "a:g w:d m:uT k k k t")
add("Time (ms) G", "Time (ms),Altitude (m),Acceleration X (G),Acceleration Y (G),Acceleration Z (G),Tilt (rad),Battery voltage (V),Liftoff,Burnout,Apogee,Continuity,IMU/SD/Baro", "tms p a:g p n:8.1 n:0 n:0 n:0 n:3 n:7")
add("imu_log_raw", "Time (s), Acceleration X (g), Acceleration Y (g), Acceleration Z (g), Angular Velocity X (deg/s), Angular Velocity Y (deg/s), Angular Velocity Z (deg/s)", "t a:g w:d")
add("nosecone", "NOSECONE SENSOR LOG DATA\nTime (ms), State, Battery Voltage (V),Accelerometer - Acceleration X (g),Accelerometer - Acceleration Y (g),Accelerometer - Acceleration Z (g),Barometer - Pressure (mbar),Barometer - Temperature (C),IMU - Angular Velocity X (deg/s),IMU - Angular Velocity Y (deg/s),IMU - Angular Velocity Z (deg/s)", "tms n:1 n:8.1 a:g p tmp w:d")
add("absolute acceleration", "Start: 2023-05-01\n\nTimestamp,Pressure (hPa),Temperature (\u00b0C),Humidity (%),Absolute Acceleration X (g),Absolute Acceleration Y (g),Absolute Acceleration Z (g),Rate of Rotation X (\u00b0/s),Rate of Rotation Y (\u00b0/s),Rate of Rotation Z (\u00b0/s),Motor Rotation (\u00b0)", "Ts p tmp p a:g w:d p")
add("ACC: X=", "", "", lines=each(lambda k, t, a, w, m: f"ACC: X={a[0] / G:.4f}g  Y={a[1] / G:.4f}g  Z={a[2] / G:.4f}g  GYRO: X={w[0] / DEG:.3f} Y={w[1] / DEG:.3f} Z={w[2] / DEG:.3f}"), want="aw", file="log.txt")
add("ACC GYRO lines", "", "", lines=lambda s: [one for k in range(N) for one in (f"ACC: {xyz(s['a'][k], G)}", f"GYRO: {xyz(s['w'][k], DEG)}")], want="aw", file="log.txt")
add("gyro: acc: mag:", "", "", lines=each(lambda k, t, a, w, m: f"gyro: {xyz(w, mark=' ')} acc: {xyz(a, mark=' ')} mag: {xyz(m, 1e-6, mark=' ')}"), want="awm", file="log.txt")
add("Ax:tab", "", "", lines=lambda s: [one for k in range(N) for one in (f"Ax:{s['a'][k][0] / G * 16384:.0f}\tAy:{s['a'][k][1] / G * 16384:.0f}\tAz:{s['a'][k][2] / G * 16384:.0f}", f"Gx:{s['w'][k][0] / DEG:f}\tGy:{s['w'][k][1] / DEG:f}\tGz:{s['w'][k][2] / DEG:f}")], want="aw", file="log.txt", expect="counts", known={"accel": "6.103515625e-05 g"})
add("mpu2, temp:", "", "", lines=each(lambda k, t, a, w, m: f"mpu2, temp: {25 + k / 600:.1f},Ax: {a[0] / G:.4f},Ay: {a[1] / G:.4f},Az: {a[2] / G:.4f}"), want="a", file="log.txt")
add("gX padded", "", "", lines=lambda s: [one for k in range(N) for one in ("gX:{:8.0f}; gY:{:8.0f}; gZ:{:8.0f}".format(*(s["w"][k] / COUNT["w"])), "aX:{:8.0f}; aY:{:8.0f}; aZ:{:8.0f}".format(*(s["a"][k] / COUNT["a"])), f"temperature:{25.1 + k / 600:f}")], want="aw", file="log.txt", expect="counts")
add("threadx", "", "", lines=lambda s: [one for k in range(N) for one in ("ax:{:f}, ay:{:f}, az:{:f}.. gx:{:f}, gy:{:f}, gz:{:f}.. mx:{:f}, my:{:f}, mz:{:f}".format(*s["a"][k] / G, *s["w"][k] / DEG, *s["m"][k] / 1e-6),)], want="awm", file="log.txt")
add("JY61P", "", "", lines=each(lambda k, t, a, w, m: f"AX:{a[0] / G:.4f} AY:{a[1] / G:.4f} AZ:{a[2] / G:.4f}"), want="a", file="log.txt")
add("linear beside", "timestamp,activity,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z,linear_acc_x,linear_acc_y,linear_acc_z,mag_x,mag_y,mag_z", "Tms s:run a:m w:r f:m m:uT")
add("imutool", "No,Time (s),Temperature (C),Gyro_x,Gyro_y,Gyro_z,Accel_x,Accel_y,Accel_z,Mag_x,Mag_y,Mag_z", "i t tmp w:d a:g m:uT")
add("rotation matrix", "timestamp,rm_m11,rm_m12,rm_m13,rm_m21,rm_m22,rm_m23,rm_m31,rm_m32,rm_m33,userAcc_x,userAcc_y,userAcc_z,gravity_x,gravity_y,gravity_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z", "t n3 n3 n3 f:g v:g w:r m:uT", want="wm")
add("qw before mag", "# timestamp,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z,qw,qx,qy,qz,mag_x,mag_y,mag_z", "Ts a:m w:r q m:uT")
add("time,acc,gyr,mag", "time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z", "t a:m w:r m:uT")
add("grid of a field", "x,y,z,mag_x,mag_y,mag_z", "", lines=each(lambda k, t, a, w, m: f"{k % 10},{k // 10 % 10},{k // 100},{xyz(m, 1e-6)}"), refuse=None, want="m", given={"rate": 100})
add("avionics", "ID,COUNT,EPOCH,MILLIS,MODE,AX,AY,AZ,ACC,ACC_KF,GX,GY,GZ,MX,MY,MZ,UTC,GPS_ALT,LAT,LON", "n:3 i sec tms s:IDLE a:m norm:m norm:m w:d m:uT s:2023-05-01 p n:48 n:11")
add("quadrotor SD", "time_ms,gx,gy,gz,ax,ay,az,mx,my,mz,roll,pitch,yaw,m1,m2,m3,m4,roll_cmd,pitch_cmd,yaw_cmd", "tms w:d a:g m:uT e k k k k p p p")
add("ORCHID", "al_lux,red_lux,mag_uT_x,mag_uT_y,mag_uT_z,gyro_dps_x,gyro_dps_y,gyro_dps_z,accel_ms2_x,accel_ms2_y,accel_ms2_z,uv_a,time_s", "k k m:uT w:d a:m p t")
add("forces only", "time,Fx,Fy,Fz,Mx,My,Mz", "t n3 n3", refuse=True)
add("targets", "\u76ee\u6807\u70b9ID,\u65f6\u95f4\u6233(\u79d2),\u4f4d\u7f6eX,\u4f4d\u7f6eY,\u4f4d\u7f6eZ,\u901f\u5ea6X,\u901f\u5ea6Y,\u901f\u5ea6Z,\u52a0\u901f\u5ea6X,\u52a0\u901f\u5ea6Y,\u52a0\u901f\u5ea6Z,\u504f\u822a\u89d2", "i Ts n3 n3 f:m p", refuse=True)
add("simulated flight", "time,position_x,position_y,position_z,velocity_x,velocity_y,velocity_z,theta_x,theta_y,theta_z,angular_velocity_x,angular_velocity_y,angular_velocity_z", "t n3 n3 e w:r")
add("tracked vehicle", "timestamp,frame_id,sequence_number,x_position,y_position,z_position,quaternion_x,quaternion_y,quaternion_z,quaternion_w,velocity_x,velocity_y,velocity_z,angular_velocity_x,angular_velocity_y,angular_velocity_z", "Ts s:map i n3 q n3 w:r")
add("steering", "Timestamp,Acceleration,Deceleration,Lane Offset,Steer Trq,Steer Accel,Steer Veloc,Speed", "t p p p p p p p", refuse=True)
add("Xsens MTi export", "// General information:\n//  MT Manager version: 2022.0\n//  Firmware Version: 1.10.0\nPacketCounter;SampleTimeFine;UTC_Valid;Acc_X;Acc_Y;Acc_Z;Gyr_X;Gyr_Y;Gyr_Z;Temperature", "", lines=each(lambda k, t, a, w, m: f"{4000 + k};{70000 + 100 * k};0;{xyz(a, mark=chr(59))};{xyz(w, mark=chr(59))};25.1"), want="aw", file="MT_0380.txt")
add("VectorNav sensor explorer", "Sample,SyncInCnt,TimeStartup (ns),UncompMagX (Gauss),UncompMagY (Gauss),UncompMagZ (Gauss),UncompAccX (m/s^2),UncompAccY (m/s^2),UncompAccZ (m/s^2),UncompGyroX (rad/s),UncompGyroY (rad/s),UncompGyroZ (rad/s),TempSensor (C)", "i n:0 tns m:G a:m w:r tmp")
add("SBG imu_data", "status\ttimestamp\taccelerometers[X]\taccelerometers[Y]\taccelerometers[Z]\tgyroscopes[X]\tgyroscopes[Y]\tgyroscopes[Z]\ttemperature\n(na)\t(us)\t(m/s^2)\t(m/s^2)\t(m/s^2)\t(rad/s)\t(rad/s)\t(rad/s)\t(degC)", "n:127 tus a:m w:r tmp", mark="\t", file="imuData.txt")
add("Lord SensorConnect", "DATA_START\nTime,inertial:scaledAccelX,inertial:scaledAccelY,inertial:scaledAccelZ,inertial:scaledGyroX,inertial:scaledGyroY,inertial:scaledGyroZ", "D a:g w:r")
add("ADI ADIS eval", "TIMESTAMP_LWR,DIAG_STAT,X_GYRO,Y_GYRO,Z_GYRO,X_ACCEL,Y_ACCEL,Z_ACCEL,TEMP,DATA_CNT", "tus n:0 w:d a:mg tmp I")
add("Honeywell HG", "Time (s)\tWx (rad/s)\tWy (rad/s)\tWz (rad/s)\tAx (m/s/s)\tAy (m/s/s)\tAz (m/s/s)\tStatus", "t w:r a:m kh", mark="\t", file="hg1120.txt")
add("Sensonor STIM", "Time,Gx[deg/s],Gy[deg/s],Gz[deg/s],Ax[g],Ay[g],Az[g],Ix[g],Iy[g],Iz[g],Cnt,Latency[us]", "t w:d a:g a:g i256 n:740")
add("Bosch BHI", "sensor_id;timestamp_ns;x;y;z", "", lines=lambda s: [one for k, t in enumerate(T) for one in (f"4;{round(t * 1e9)};{xyz(s['a'][k], G, mark=';')}", f"13;{round(t * 1e9)};{xyz(s['w'][k], DEG, mark=';')}")], want="aw", refuse=True)
add("Unicleo", "Time [us]\tAcc X [mg]\tAcc Y [mg]\tAcc Z [mg]\tGyro X [mdps]\tGyro Y [mdps]\tGyro Z [mdps]\tMag X [mGauss]\tMag Y [mGauss]\tMag Z [mGauss]\tTemp [\u00b0C]", "tus a:mg w:md m:mG tmp", mark="\t", file="unicleo.tsv")
add("STWIN HSDatalog", "Time,A_x [g],A_y [g],A_z [g]", "t a:g", file="ism330dhcx_acc.csv")
add("STWIN gyro", "Time,G_x [mdps],G_y [mdps],G_z [mdps]", "t w:md", file="ism330dhcx_gyro.csv")
add("InvenSense sensor log", "SENSOR_RAW_ACCELEROMETER_TS,X,Y,Z", "tus a:c", file="raw_accel.csv", expect="counts")
add("ICM-42688 SmartMotion", "INV_SENSOR_TS_US,ACC_X_G,ACC_Y_G,ACC_Z_G,GYR_X_DPS,GYR_Y_DPS,GYR_Z_DPS,TEMP_C", "tus a:g w:d tmp")
add("Murata 2", "Time(ms);ACC_X(LSB);ACC_Y(LSB);ACC_Z(LSB);RATE_X(LSB);RATE_Z(LSB)", "", lines=each(lambda k, t, a, w, m: f"{10 * k};{a[0] / G * 4905:.0f};{a[1] / G * 4905:.0f};{a[2] / G * 4905:.0f};{w[0] / DEG * 80:.0f};{w[2] / DEG * 80:.0f}"), want="a", known={"accel": f"{1 / 4905:.12g} g"}, refuse=None)
add("KVH 1750", "Timestamp [s];Rate X [rad/s];Rate Y [rad/s];Rate Z [rad/s];Accel X [g];Accel Y [g];Accel Z [g];Status;Seq;Temp [C]", "t w:r a:g kh i256 tmp", mark=";")
add("iNAT", "GPSTime[s]\tomgX[deg/s]\tomgY[deg/s]\tomgZ[deg/s]\taccX[m/s^2]\taccY[m/s^2]\taccZ[m/s^2]", "tow w:d a:m", mark="\t", file="inat.txt")
add("OXTS NAVgraph", "Time (GPS s),Acceleration Xv (m/s\u00b2),Acceleration Yv (m/s\u00b2),Acceleration Zv (m/s\u00b2),Angular rate Xv (\u00b0/s),Angular rate Yv (\u00b0/s),Angular rate Zv (\u00b0/s)", "tow a:m w:d")
add("Racelogic", "time since midnight (s);longacc (g);latacc (g);vertacc (g);yaw rate (\u00b0/s);pitch rate (\u00b0/s);roll rate (\u00b0/s)", "t a:g wzyx:d", mark=";", edit=comma)
add("AiM 2", '"Format","AiM CSV File"\n"Sample Rate","100"\n\n"Time","InlineAcc","LateralAcc","VerticalAcc","RollRate","PitchRate","YawRate"\n"sec","g","g","g","deg/s","deg/s","deg/s"\n', "t a:g w:d")
add("MoTeC 2", '"Format","MoTeC CSV File"\n"Venue","x"\n"Sample Rate","100.000","Hz"\n\n"Time","G Force Long","G Force Lat","G Force Vert","Gyro Roll Velocity","Gyro Pitch Velocity","Gyro Yaw Velocity"\n"s","G","G","G","deg/s","deg/s","deg/s"\n', "t a:g w:d")
add("Vbox micro", "sats,time,lat,long,velocity,heading,height,x_accel,y_accel,z_accel,temp,pitch_rate,roll_rate,yaw_rate", "n:9 C n:48 n:11 p p p a:g tmp wyxz:d")
add("CAN signals of a BNO", "timestamps;IMU_AccX[m/s2];IMU_AccY[m/s2];IMU_AccZ[m/s2];IMU_RateX[deg/s];IMU_RateY[deg/s];IMU_RateZ[deg/s]", "t a:m w:d", mark=";")
add("ASAMMDF export", "timestamps,Imu.AccelX [m/s^2],Imu.AccelY [m/s^2],Imu.AccelZ [m/s^2],Imu.GyroX [deg/s],Imu.GyroY [deg/s],Imu.GyroZ [deg/s]", "t a:m w:d")
add("Vector CSV", "Time[s],CAN1::IMU::AccX[g],CAN1::IMU::AccY[g],CAN1::IMU::AccZ[g],CAN1::IMU::GyrX[\u00b0/s],CAN1::IMU::GyrY[\u00b0/s],CAN1::IMU::GyrZ[\u00b0/s]", "t a:g w:d")
add("MATLAB timetable", "Time,AngularVelocity_1,AngularVelocity_2,AngularVelocity_3,Acceleration_1,Acceleration_2,Acceleration_3", "", lines=each(lambda k, t, a, w, m: f"{t:.2f} sec,{xyz(w)},{xyz(a)}"), want="wa")
add("MATLAB duration", "Time,Var1_1,Var1_2,Var1_3", "", lines=each(lambda k, t, a, w, m: f"00:00:{t:09.6f},{xyz(a)}"), want="a")
add("LabVIEW spreadsheet", "Untitled\tAcc X (m/s^2)\tAcc Y (m/s^2)\tAcc Z (m/s^2)", "t a:m", mark="\t", edit=comma, file="log.txt")
add("NI csv", "Time,cDAQ1Mod1/ai0 (g),cDAQ1Mod1/ai1 (g),cDAQ1Mod1/ai2 (g)", "D a:g")
add("Excel German", "Zeit (s);Besch. X (g);Besch. Y (g);Besch. Z (g);Gyro X (\u00b0/s);Gyro Y (\u00b0/s);Gyro Z (\u00b0/s)", "t a:g w:d", mark=";", edit=comma, encoding="cp1252")
add("Excel sep", "sep=;\nTime [s];a_x [m/s\u00b2];a_y [m/s\u00b2];a_z [m/s\u00b2]", "t a:m", mark=";", encoding="utf-8-sig")
add("Dewetron", "Time (s);ACC X (m/s\u00b2);ACC Y (m/s\u00b2);ACC Z (m/s\u00b2);Omega X (rad/s);Omega Y (rad/s);Omega Z (rad/s)", "t a:m w:r", mark=";", edit=comma)
add("imc", "x-Achse [s]\taccx [g]\taccy [g]\taccz [g]", "t a:g", mark="\t", edit=comma)
add("DASYLab", "DASYLab - V 13.00\nArbeitsblatt Name: acc\nAufnahmedatum: 01.05.2023, 11:59:58\nBlockl\u00e4nge: 100\nDelta: 0.01 sec.\nKanalanzahl: 3\nDatum;Meszzeit [hh:mm:ss,sss];Acc X [g];Acc Y [g];Acc Z [g];", "", lines=each(lambda k, t, a, w, m: f"01.05.2023;{MOM[k]:%H:%M:%S},{MOM[k].microsecond // 1000:03d};{comma(xyz(a, G, mark=';'))};"), want="a", encoding="cp1252")
add("Brüel", "# Title: acc\n# X-axis: s\nTime;Signal 1 X [m/s\u00b2];Signal 1 Y [m/s\u00b2];Signal 1 Z [m/s\u00b2]", "t a:m", mark=";")
add("Gulf Coast X16", ";Title, http://www.gcdataconcepts.com, X16-1D\n;Version, 1113, Build date, Nov 14 2014\n;Start_time, 2023-05-01, 11:59:58.000\n;Temperature, 25.00, deg C\n;SampleRate, 100,Hz\n;Deadband, 0, counts\n;DeadbandTimeout, 5.000,sec\n;Headers, time,Ax,Ay,Az", "", lines=each(lambda k, t, a, w, m: f"{t:.4f},{a[0] / G * 2048:.0f},{a[1] / G * 2048:.0f},{a[2] / G * 2048:.0f}"), want="a", known={"accel": f"{1 / 2048:.12g} g"})
add("Shimmer units", "sep=\t\nShimmer_AC1_Timestamp_Unix_CAL\tShimmer_AC1_Accel_LN_X_CAL\tShimmer_AC1_Accel_LN_Y_CAL\tShimmer_AC1_Accel_LN_Z_CAL\tShimmer_AC1_Gyro_X_CAL\tShimmer_AC1_Gyro_Y_CAL\tShimmer_AC1_Gyro_Z_CAL\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tdeg/s\tdeg/s\tdeg/s", "Tms a:m w:d", mark="\t")
add("Garmin 2", "timestamp,accel_x,accel_y,accel_z,label", "Tms a:mg s:none")
add("Fitbit", "timestamp,x_axis,y_axis,z_axis", "Tms a:m", file="accelerometer_fitbit.csv")
add("Bangle", "timestamp_ms,x,y,z,hr", "tms a:g n:70", file="bangle_accel.csv")
add("PineTime", "t;accX;accY;accZ;hr", "tms a:mg n:70", mark=";")
add("Apple watch crew", "sessionTime;xAcc;yAcc;zAcc;xRot;yRot;zRot", "t a:g w:r", mark=";")
add("Samsung", "create_time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z", "Tms a:m w:r")
add("PAMAP2", "", "", lines=each(lambda k, t, a, w, m: f"{8.38 + t:.2f} 1 {100 if k % 10 == 0 else 'NaN'} 30.375 {xyz(a, mark=' ')} {xyz(a * 1.001, mark=' ')} {xyz(w, mark=' ')} {xyz(m, 1e-6, mark=' ')} 1 0 0 0"), want="awm", file="subject101.dat", refuse="columns_unclear")
add("OPPORTUNITY", "MILLISEC accRKN_x accRKN_y accRKN_z", "tms a:mg", mark=" ", file="S1-ADL1.txt")
add("RealDISP", "Time(s),Sensor,AccX(m/s2),AccY(m/s2),AccZ(m/s2),GyrX(deg/s),GyrY(deg/s),GyrZ(deg/s)", "t s:LC a:m w:d")
add("UCI HAR smartphone", "acc_x acc_y acc_z", "a:g", mark=" ", file="acc_exp01_user01.txt")
add("MotionSense 2", ",attitude.roll,attitude.pitch,attitude.yaw,gravity.x,gravity.y,gravity.z,rotationRate.x,rotationRate.y,rotationRate.z,userAcceleration.x,userAcceleration.y,userAcceleration.z", "i e v:g w:r f:g", want="w", file="sub_1.csv")
add("KU-HAR", "Time,AccX,AccY,AccZ,Time2,GyroX,GyroY,GyroZ", "t a:m t w:r")
add("Zenodo gait", "Time;Acc_X;Acc_Y;Acc_Z;Gyr_X;Gyr_Y;Gyr_Z;Mag_X;Mag_Y;Mag_Z\n[s];[m/s2];[m/s2];[m/s2];[rad/s];[rad/s];[rad/s];[uT];[uT];[uT]", "t a:m w:r m:uT", mark=";")
add("parkinson", "Timestamp,Left Wrist ACC X,Left Wrist ACC Y,Left Wrist ACC Z,Left Wrist GYR X,Left Wrist GYR Y,Left Wrist GYR Z", "t a:g w:d")
add("horse", "DateTime,Ax,Ay,Az,Gx,Gy,Gz,Mx,My,Mz,label", "D a:m w:r m:uT s:trot")
add("ARGOS bird", "device_id,UTC_datetime,UTC_date,UTC_time,datatype,acc_x,acc_y,acc_z", "n:182 D D2 C s:SENSORS a:mg")
add("Movebank", "event-id,visible,timestamp,acceleration-raw-x,acceleration-raw-y,acceleration-raw-z,sensor-type", "i s:true D a:c s:acceleration", expect="counts")
add("Techno", "TagID,Date,Time,X,Y,Z,Activity,Depth", "s:T1 Du C a:g n:0 p", file="tag_acc.csv")
add("INS of PX4 hil", "timestamp,hil_sensor.xacc,hil_sensor.yacc,hil_sensor.zacc,hil_sensor.xgyro,hil_sensor.ygyro,hil_sensor.zgyro,hil_sensor.xmag,hil_sensor.ymag,hil_sensor.zmag", "tus a:m w:r m:G")
add("Foxglove 2", "topic,log_time,header.stamp,angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z", "s:/imu Tns Ts w:r a:m")
add("rosbag2csv", "rosbagTimestamp,header,seq,stamp,secs,nsecs,frame_id,angular_velocity,x,y,z,linear_acceleration,x.1,y.1,z.1", "Tns z i z sec nsec s:imu z w:r z a:m")
add("ros2 topic echo csv", "", "", lines=each(lambda k, t, a, w, m: f"{E0 + int(t + 1e-9)},{round((t % 1) * 1e9) % 10**9},imu_link,0.0,0.0,0.0,1.0,{','.join(['0.0'] * 9)},{xyz(w)},{','.join(['0.0'] * 9)},{xyz(a)},{','.join(['0.0'] * 9)}"), want="aw")
add("Crazyflie 2", "timestamp,acc.x,acc.y,acc.z,gyro.x,gyro.y,gyro.z", "tms a:g w:d")
add("Crazyflie stab", "time,stateEstimate.x,stateEstimate.y,stateEstimate.z,gyro.x,gyro.y,gyro.z", "tms n3 w:d")
add("Tello 2", "time,pitch,roll,yaw,vgx,vgy,vgz,templ,temph,tof,h,bat,baro,agx,agy,agz", "t e p p p tmp tmp k k n:80 p a:cm")
add("Parrot", "time_us,imu_acc_x,imu_acc_y,imu_acc_z,imu_gyro_x,imu_gyro_y,imu_gyro_z", "tus a:m w:r")
add("DJI datcon", "Clock:Tick#,Clock:offsetTime,IMU_ATTI(0):Longitude,IMU_ATTI(0):Latitude,IMU_ATTI(0):accel:X,IMU_ATTI(0):accel:Y,IMU_ATTI(0):accel:Z,IMU_ATTI(0):gyro:X,IMU_ATTI(0):gyro:Y,IMU_ATTI(0):gyro:Z,IMU_ATTI(0):mag:X,IMU_ATTI(0):mag:Y,IMU_ATTI(0):mag:Z", "I t n:11 n:48 a:g w:d m:mG")
add("iNav csv", "loopIteration,time (us),gyroADC[0] (deg/s),gyroADC[1] (deg/s),gyroADC[2] (deg/s),accSmooth[0] (g),accSmooth[1] (g),accSmooth[2] (g)", "i tus w:d a:g")
add("ArduPilot mavexplorer", "TimeUS,IMU.GyrX,IMU.GyrY,IMU.GyrZ,IMU.AccX,IMU.AccY,IMU.AccZ", "tus w:r a:m")
add("GoPro telemetry", '"cts","date","Accelerometer [m/s2]","1","2","temperature [\u00b0C]"', "tms0 D azxy:m tmp", want="a", knows={"columns": {"time": 0, "accel": "3,4,2"}})
add("gyro of GoPro", "cts,date,Gyroscope (z) [rad/s],Gyroscope (x) [rad/s],Gyroscope (y) [rad/s],temperature [\u00b0C]", "tms0 D wzxy:r tmp")
add("Sony", "timestamp_ms,frame,gyro_x_raw,gyro_y_raw,gyro_z_raw", "tms i w:c", expect="counts")
add("Livox", "stamp,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", "Tns w:r a:g")
add("Ouster", "ts_ns,la_x,la_y,la_z,av_x,av_y,av_z", "Tns a:m w:r")
add("Unitree 2", "tick,imu_quat0,imu_quat1,imu_quat2,imu_quat3,imu_gyro0,imu_gyro1,imu_gyro2,imu_acc0,imu_acc1,imu_acc2,imu_temp", "tms q w:r a:m tmp")
add("submarine", "utc_s,ahrs_ax_mps2,ahrs_ay_mps2,ahrs_az_mps2,ahrs_p_rps,ahrs_q_rps,ahrs_r_rps,depth_m", "Ts a:m w:r p")
add("balance robot", "ms\tpitch\tgx\tgy\tgz\tax\tay\taz\tpwm", "tms p w:d a:g k", mark="\t", file="run1.txt")
add("wheelchair", "Epoch Time (s),Frame Acc X (g),Frame Acc Y (g),Frame Acc Z (g),Frame Gyr X (dps),Frame Gyr Y (dps),Frame Gyr Z (dps)", "Ts a:g w:d")
add("jsonl nested", "", "", lines=each(lambda k, t, a, w, m: '{"timestamp": %d, "accelerometer": {"x": %.5f, "y": %.5f, "z": %.5f}, "gyroscope": {"x": %.5f, "y": %.5f, "z": %.5f}, "magnetometer": {"x": %.3f, "y": %.3f, "z": %.3f}}' % (E0 * 1000 + 10 * k, *a, *w, *m / 1e-6)), want="awm", file="log.jsonl")
add("json payload", "", "", lines=lambda s: ['{"messageId": 1, "sessionId": "x", "deviceId": "y", "payload": [' + ",".join('{"name": "accelerometer", "time": %d, "values": {"x": %.5f, "y": %.5f, "z": %.5f}}' % (E0 * 10**9 + 10**7 * k, *s["a"][k]) for k in range(N)) + "]}"], want="a", file="log.json")
add("json arrays", "", "", lines=lambda s: ['{"fs": 100, "acc": {"x": [' + ",".join(f"{v:.5f}" for v in s["a"][:, 0]) + '], "y": [' + ",".join(f"{v:.5f}" for v in s["a"][:, 1]) + '], "z": [' + ",".join(f"{v:.5f}" for v in s["a"][:, 2]) + "]}}"], want="a", file="log.json")
add("edge impulse json", "", "", lines=lambda s: ['{"protected": {"ver": "v1"}, "payload": {"device_type": "X", "interval_ms": 10, "sensors": [{"name": "accX", "units": "m/s2"}, {"name": "accY", "units": "m/s2"}, {"name": "accZ", "units": "m/s2"}], "values": [' + ",".join(f"[{xyz(a)}]" for a in s["a"]) + "]}}"], want="a", file="log.json")
add("key=value commas", "", "", lines=each(lambda k, t, a, w, m: f"t={4321 + 10 * k},ax={a[0]:.4f},ay={a[1]:.4f},az={a[2]:.4f},gx={w[0]:.5f},gy={w[1]:.5f},gz={w[2]:.5f}"), want="aw", file="log.txt")
add("ESP_LOGI", "", "", lines=each(lambda k, t, a, w, m: f"I ({4321 + 10 * k}) mpu6050: acce_x:{a[0] / G:.4f}, acce_y:{a[1] / G:.4f}, acce_z:{a[2] / G:.4f}, gyro_x:{w[0] / DEG:.3f}, gyro_y:{w[1] / DEG:.3f}, gyro_z:{w[2] / DEG:.3f}"), want="aw", file="log.txt")
add("Zephyr", "", "", lines=each(lambda k, t, a, w, m: f"[00:00:{int(t + 1e-9):02d}.{k % 100 * 10:03d},000] <inf> imu: accel {xyz(a, mark=' ')} gyro {xyz(w, mark=' ')}"), want="aw", file="log.txt", refuse=None)
# --- and after the mends of these
add("measurement_id", "measurement_id,user_name,time_stamp,activity,accelerometer_x,accelerometer_y,accelerometer_z,gyroscope_x,gyroscope_y,gyroscope_z,rotation_pitch,rotation_roll,rotation_yaw", "n:3 s:bob Ts s:walk a:g w:d e")
add("GSR", "timestamp,gsr_raw,gsr_kohms,skin_temp_celsius,accelerometer_x,accelerometer_y,accelerometer_z", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + f"Z,{2048 + k % 9},150.5,32.1,{xyz(a, G)}"), want="a")
add("flex glove", "Flex1,Flex2,Flex3,Flex4,Accelerometer_X,Accelerometer_Y,Accelerometer_Z,Gyroscope_X,Gyroscope_Y,Gyroscope_Z", "k k k k a:c w:c", expect="counts")
add("ISO at the phone", "timestamp,accelerometer_x,accelerometer_y,accelerometer_z,gyroscope_x,gyroscope_y,gyroscope_z,activity", "", lines=each(lambda k, t, a, w, m: f"{MOM[k]:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + f"Z,{xyz(a)},{xyz(w)},Walk"), want="aw")
add("two stamps, nograv", "phone_timestamp,server_received_timestamp,accelerometer_x,accelerometer_y,accelerometer_z,accel_nograv_x,accel_nograv_y,accel_nograv_z,gyroscope_alpha,gyroscope_beta,gyroscope_gamma,orientation_alpha,orientation_beta,orientation_gamma", "Tms Tms a:m f:m wzxy:d e")
add("platform", "Timestamp,Accelerometer_X,Accelerometer_Y,Accelerometer_Z,Gyroscope_X,Gyroscope_Y,Gyroscope_Z,L2_Norm,Platform", "Tms a:m w:r norm:m s:android")
add("Muse 2", "TimeStamp,RAW_TP9,RAW_AF7,RAW_AF8,RAW_TP10,Accelerometer_X,Accelerometer_Y,Accelerometer_Z,Gyro_X,Gyro_Y,Gyro_Z,HeadBandOn,Battery", "D p p p p a:g w:d n:1 n:90")
add("ESC bench", "GlobalTime,LocalTime,EscCurrent,EscVoltage,EscPower,MotorRpm,AccelerationX,AccelerationY,AccelerationZ,GyroscopeX,GyroscopeY,GyroscopeZ,MagnetX,MagnetY,MagnetZ", "D tms p n:22.2 p k a:m w:r m:uT")
add("linear only", "LinearAccelerationX,LinearAccelerationY,LinearAccelerationZ,GyroscopeX,GyroscopeY,GyroscopeZ", "f:m w:r", want="w")
add("mag before gyro", "timestamp,accelerometerX,accelerometerY,accelerometerZ,magnetometerX,magnetometerY,magnetometerZ,gyroscopeX,gyroscopeY,gyroscopeZ", "Tms a:m m:uT w:r")
add("MagneticX", "Timestamp,AccelerometerX,AccelerometerY,AccelerometerZ,MagneticX,MagneticY,MagneticZ,GyroscopeX,GyroscopeY,GyroscopeZ,Light,LocationLatitude,LocationLongitude", "Tms a:m m:uT w:r k n:48 n:11")
add("Sense HAT 2", "time,yaw,pitch,roll,compassNorth,magnetometerX,magnetometerY,magnetometerZ,gyroscopeX,gyroscopeY,gyroscopeZ,accelerometerX,accelerometerY,accelerometerZ", "Ts e p m:uT w:r a:g")
add("sequence only", "sequence,AccelerometerX,AccelerometerY,AccelerometerZ,GyroscopeX,GyroscopeY,GyroscopeZ", "i a:g w:d")
add("frame and time", "FrameNumber,Timestamp,GyroscopeX,GyroscopeY,GyroscopeZ,AccelerometerX,AccelerometerY,AccelerometerZ,MagnetometerX,MagnetometerY,MagnetometerZ", "i tns w:r a:m m:uT")
add("spaces in the header", "time [us],a_x, a_y,a_z,omega_x,omega_y,omega_z,acc range,gyro range", "tus a:g w:d n:2 n:250")
add("robot omega", "timestamp_s,x,y,z,qw,qx,qy,qz,vx,vy,vz,omega_x,omega_y,omega_z", "t n3 q n3 w:r")
add("web server", "Timestamp(ms),AccX(g),AccY(g),AccZ(g),GyroX(deg/s),GyroY(deg/s),GyroZ(deg/s)", "tms a:g w:d")
add("rocket Event", "Time(ms),Altitude(m),Pressure(Pa),Temp(C),AccX(G),AccY(G),AccZ(G),AccMag(G),Velocity(m/s),Event", "tms p p tmp a:g norm:g p s:PAD")
add("d/s", "Timestamp(ms),AccX(g),AccY(g),AccZ(g),GyroX(d/s),GyroY(d/s),GyroZ(d/s)", "tms a:g w:d", file="sensor_log.txt")
add("LM35", "Time(ms),Temp(C),Pressure(hPa),Alt(m),FiltAlt(m),AccX(g),AccY(g),AccZ(g),GyroX(deg/s),GyroY(deg/s),GyroZ(deg/s),AngleX(deg),AngleY(deg),AngleZ(deg),LM35Temp(C)", "tms tmp p p p a:g w:d e tmp")
add("fall", "accX(g),accY(g),accZ(g),gX(\u00b0/s),gY(\u00b0/s),gZ(\u00b0/s),accMag(g),gyroMag(g),distance(cm),pressure(Pa),altitude(m),Fall Status", "a:g w:d norm:g p p p p s:no")
add("OBD", "Time(s),RPM,Speed(kph),CoolantTemp(C),TPS(%),AccX(g),AccY(g),AccZ(g),GyroX(dps),GyroY(dps),GyroZ(dps),A1,A2,A3,A4,A5", "t k p tmp p a:g w:d k k k k k")
add("thrust bench", "run_id,source,sequence,elapsed_ms,throttle_pct,thrust_g,current_a,acc_x_g,acc_y_g,acc_z_g,sound_db_uncalibrated,thrust_raw_adc,sound_raw_adc", "n:4 s:bench i tms p p p a:g p k k")
add("LOG_HEADER", "LOG_HEADER,ms,mic_level,bpm,acc_x_g,acc_y_g,acc_z_g,raw_x,raw_y,raw_z,acc_diag_flags", "s:LOG tms k n:70 a:g a:c n:0")
add("labelled session", "timestamp_ms,label,acc_x_g,acc_y_g,acc_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps", "tms s:rest a:g w:d")
add("Nano bridge", "seq,timestamp_s,acc_x_g,acc_y_g,acc_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps", "i t a:g w:d")
add("three clocks and raw", "t_host_us,t_rel_s,t_dev_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps,temp_c,mag_x_ut,mag_y_ut,mag_z_ut,acc_x_raw,acc_y_raw,acc_z_raw,gyr_x_raw,gyr_y_raw,gyr_z_raw", "Tus t tus a:g w:d tmp m:uT a:c w:c")
add("stimulus", "time_s,sequence,stimulus_code,acc_x_g,acc_y_g,acc_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,angle_x_deg,angle_y_deg,angle_z_deg", "t i n:0 a:g w:d e")
add("OpenCR", "time_ms,qw,qx,qy,qz,roll_deg,pitch_deg,yaw_deg,gyro_x_dps,gyro_y_dps,gyro_z_dps,acc_x_g,acc_y_g,acc_z_g,gyro_x_adc,gyro_y_adc,gyro_z_adc,acc_x_adc,acc_y_adc,acc_z_adc", "tms q e w:d a:g w:c a:c")
add("local_time", "local_time,utc_time,packets,bad_packets,acc_x_g,acc_y_g,acc_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,roll_deg,pitch_deg,yaw_deg,mag_x,mag_y,mag_z,temp_c,temp_f,q0,q1,q2,q3,last_frame_type", "D D i n:0 a:g w:d e m:uT tmp n:77 q n:81")
add("ang_vel", "timestamp,ang_vel_x,ang_vel_y,ang_vel_z,lin_acc_x,lin_acc_y,lin_acc_z", "Tns w:r a:m", file="vn100_imu.csv")
add("ang_vel with q", "timestamp, q_x, q_y, q_z, q_w, ang_vel_x, ang_vel_y, ang_vel_z, lin_acc_x, lin_acc_y, lin_acc_z", "Ts q w:r a:m", mark=", ")
add("ID and ang_vel", "ID,Ang_Vel_X,Ang_Vel_Y,Ang_Vel_Z,Lin_Acc_X,Lin_Acc_Y,Lin_Acc_Z", "i w:r a:m")
add("imu_stream", "index,time_ns,ang_vel_x,ang_vel_y,ang_vel_z,lin_acc_x,lin_acc_y,lin_acc_z,ori_x,ori_y,ori_z,ori_w", "i Tns w:r a:m q")
add("GRP", "time;xacc;yacc;zacc;WX;WY;WZ;dt [us]", "t a:g w:d n:10000", mark=";")
add("RC3", "", "", lines=each(lambda k, t, a, w, m: f"$RC3,{120000 + 10 * k},{k},{xyz(a, G)},{xyz(w, DEG)},0,0,12.1,3.3*{k % 256:02X}"), want="aw", file="log.txt", knows={"columns": {"time": 1, "accel": "3:5", "gyro": "6:8"}})
add("ns rad_s", "timestamp_ns,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2", "tns w:r a:m")
add("two timestamps glasses", "timestamp,timestamp_ns,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,quat_w,quat_x,quat_y,quat_z,temperature", "Ts Tns w:d a:m q tmp")
add("gyro file", "timestamp_ns,gyro_x,gyro_y,gyro_z", "tns w:r", file="gyro_20230501.csv")
add("acc file with notes", "\u59d3\u540d: x\n\u624b: left\n\u624b\u52bf: tap\n---\ntimestamp_ns,acc_x,acc_y,acc_z", "tns a:g", file="acc.csv")
add("ns wide", "timestamp_ns,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z", "Tns w:r a:m")
add("Livox ns", "timestamp_ns,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", "Tns w:r a:g")
add("long names", '"Time","Acc X","Acc Y","Acc Z","Gyroscope X","Gyroscope Y","Gyroscope Z","Magnetometer X","Magnetometer Y","Magnetometer Z","Orientation X"', "t a:m w:r m:uT p")
add("ax = mg", "", "", lines=each(lambda k, t, a, w, m: f"ax = {a[0] / G * 1000:.1f} ay = {a[1] / G * 1000:.1f} az = {a[2] / G * 1000:.1f} mg"), want="a", file="log.txt")
add("aX | aY", "", "", lines=each(lambda k, t, a, w, m: " | ".join(f"{n} = {v:6.0f}" for n, v in zip(["aX", "aY", "aZ", "tmp", "gX", "gY", "gZ"], [*(a / COUNT["a"]), -3000 + k, *(w / COUNT["w"])], strict=True))), want="aw", file="log.txt", expect="counts")
add("GlobalAcc", "time,RawAccX,RawAccY,RawAccZ,RawGyroX,RawGyroY,RawGyroZ,GlobalAccX,GlobalAccY,GlobalAccZ,Roll,Pitch,Yaw,StepLabel", "t a:m w:r f:m e n:0")
add("Parachute", "Timestamp,BMP Temp,Pressure,Absolute Altitude,Relative Altitude,MPU Temp,RawAccX,RawAccY,RawAccZ,AccX_Calib,AccY_Calib,AccZ_Calib,GyroX,GyroY,GyroZ,Parachute Status", "D tmp p p p tmp a:g a:g w:d n:0")
add("dancer", "dancer,time,wristAccX,wristAccY,wristAccZ,wristGyroX,wristGyroY,wristGyroZ", "n:1 Tms a:g w:d")
add("RS41", "frame,air_temp_degC,humdity_percent,pres_mb,pcb_supply_V,magX_mG,magY_mG,magZ_mG,accelX_mg,accelY_mg,accelZ_mg,cal_active,roll_deg,pitch_deg,heading_deg", "i tmp p p n:5.1 m:mG a:mg n:0 e")
add("TRACE", "RTK_UTC,RTK_EAST,RTK_NORTH,RTK_SPEED,RTK_ANGLE,RTK_FIX,Time,Acc_x,Acc_y,Acc_z,Acc_Magnitude,Gyro_x,Gyro_y,Gyro_z,Mag_x,Mag_y,Mag_z,Heading", "s:115958 p p p p n:4 Ts a:m norm:m w:d m:uT p")
add("trust score", "timestamp,gps_trust_score,accel_x,accel_y,accel_z,linear_accel_x,linear_accel_y,linear_accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,heading_deg,step_count,satellites_total", "Tms p a:m f:m w:r m:uT p n:4 n:12")
add("Portuguese rocket", "timestamp_ms,type,seq,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,temp_c,pressure_mbar,altitude_m,mag_x,mag_y,mag_z,heading_deg,roll_deg,pitch_deg,latitude,longitude,gps_alt,lock,satellites,quat_w,quat_x,quat_y,quat_z,lia_x,lia_y,lia_z", "tms s:IMU i a:m w:r tmp p p m:uT e n:48 n:11 p n:1 n:9 q f:m")
add("elapsed_sec", "# ground_truth_turns=4\ntimestamp_ms,elapsed_sec,step_count,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,heading_deg", "Tms t n:3 a:g w:r m:uT p")
add("drift buoy", "timestamp,water_temp_C,imu_temp_C,rtd_ohms,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,mag_x,mag_y,mag_z,heading,roll,pitch,pi_strength", "D tmp tmp p a:m w:r m:uT e p")
add("pre flight", "Time,Latitude,Longitude,GPS_Altitude,BMP_Altitude,BMP_Temperature,Pressure,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ,MPU_Temperature,Mag_X,Mag_Y,Mag_Z,Heading", "tms n:48 n:11 p p tmp p a:m w:r tmp m:uT p")
add("lo_rssi", "timestamp,latitude,longitude,altitude,velocity,temperature,humidity,pressure,gas_resistance,accel_x,accel_y,accel_z,mag_x,mag_y,mag_z,heading,uv_index,lux,battery_percent,lo_rssi", "D n:-23 n:-46 p p tmp p p k a:m m:uT p p k n:85 n:-65")
add("t_ms state label", "t_ms,ax,ay,az,gx,gy,gz,state,label", "tms a:m w:r n:1 s:7")
add("RAW lines", "", "", lines=each(lambda k, t, a, w, m: f"RAW,{4321 + 10 * k},{','.join(f'{v:.0f}' for v in a / COUNT['a'])},{','.join(f'{v:.0f}' for v in w / COUNT['w'])}"), want="aw", file="log.txt", expect="counts", knows={"columns": {"time": 1, "accel": "2:4", "gyro": "5:7"}})
add("SESSION_BEGIN", "SESSION_BEGIN,0,still,100,600\nt_ms,ax,ay,az,gx,gy,gz", "tms a:g w:d")
add("boot", "# boot\n# t_ms,ax,ay,az,gx,gy,gz,mx,my,mz,force,pressure_hpa,baro_alt_m,climb_ms,gps_alt_m,gps_lat,gps_lon", "tms a:g w:d m:uT p p p n:0.1 p n:48 n:11")
add("service lines", "# plot_static\nt_ms,ax,ay,az,gx,gy,gz,fix,east,north,spd", "tms a:g w:d n:4 p p p")
add("surface", "surface,test,t_ms,ax,ay,az,gx,gy,gz", "s:grass n:1 tms a:m w:r")
add("Mbientlab two hands", "epoch (ms),time (13:00),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)", "Tms D t w:d", file="MetaWear_2023-05-01_Gyroscope.csv")
add("Xsens MVN sheet", "Frame,Pelvis x,Pelvis y,Pelvis z,T8 x,T8 y,T8 z", "i f:m f:m", refuse=True)
add("Trigno lab", "Time (s),R Foot: Acc X (g),R Foot: Acc Y (g),R Foot: Acc Z (g),R Foot: Gyro X (deg/s),R Foot: Gyro Y (deg/s),R Foot: Gyro Z (deg/s)", "t a:g w:d")
add("Vicon BlueTrident", "time_s,ax_m/s/s,ay_m/s/s,az_m/s/s,gx_deg/s,gy_deg/s,gz_deg/s,mx_uT,my_uT,mz_uT,hx_m/s/s,hy_m/s/s,hz_m/s/s", "t a:m w:d m:uT a:m")
add("Catapult 2", "Timestamp,Seconds,Velocity,Acceleration,Odometer,Latitude,Longitude,PlayerLoad,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z", "C t p p p n:48 n:11 p a:g w:d")
add("openBCI", "%OpenBCI Raw EEG Data\n%Number of channels = 4\n%Sample Rate = 100 Hz\nSample Index, EXG Channel 0, EXG Channel 1, Accel Channel 0, Accel Channel 1, Accel Channel 2, Timestamp", "i256 p p a:g Ts")
add("BITalino", "# timestamp accX accY accZ", "Ts a:g", mark=" ", file="log.txt")
add("Movella Xsens Awinda", "Time;Acc_X;Acc_Y;Acc_Z;Gyr_X;Gyr_Y;Gyr_Z;Roll;Pitch;Yaw", "t a:m w:r e", mark=";")
add("ADXL sheet", "Time [ms];X [g];Y [g];Z [g]", "tms a:g", mark=";", edit=comma)
add("ICM EVB", "Timestamp_us,Accel_X_LSB,Accel_Y_LSB,Accel_Z_LSB,Gyro_X_LSB,Gyro_Y_LSB,Gyro_Z_LSB,Temp_LSB", "tus a:c w:c k", expect="counts")
add("RM3100", "time,x_nT,y_nT,z_nT", "D m:nT")
add("QMC", "ms,mx_gauss,my_gauss,mz_gauss", "tms m:G")
add("LIS3MDL", "Time (ms), MagX (mGauss), MagY (mGauss), MagZ (mGauss)", "tms m:mG")
add("IMU of a ship", "UTC;Roll Rate (deg/s);Pitch Rate (deg/s);Yaw Rate (deg/s);Acc X (m/s2);Acc Y (m/s2);Acc Z (m/s2);Heave (m)", "D w:d a:m p", mark=";")
add("Novatel Inertial Explorer ASCII", "GPSTime,GyroX(rad/s),GyroY(rad/s),GyroZ(rad/s),AccelX(m/s^2),AccelY(m/s^2),AccelZ(m/s^2)", "tow w:r a:m")
add("SBG parsed", "time_us,gyro_x_radps,gyro_y_radps,gyro_z_radps,accel_x_mps2,accel_y_mps2,accel_z_mps2,imu_temp_degC", "tus w:r a:m tmp")
add("KITTI csv", "timestamp,lat,lon,alt,roll,pitch,yaw,ax,ay,az,af,al,au,wx,wy,wz", "D L e a:m v:m w:r")
add("TartanAir", "time,gyro_x(rad/s),gyro_y(rad/s),gyro_z(rad/s),acc_x(m/s2),acc_y(m/s2),acc_z(m/s2)", "t w:r a:m", mark=",")
add("rpg", "# id timestamp omega_x omega_y omega_z acc_x acc_y acc_z", "i t w:r a:m", mark=" ", file="imu.txt")
add("ASL topic", "%time,field.header.stamp,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z,field.linear_acceleration.x,field.linear_acceleration.y,field.linear_acceleration.z", "Tns Tns w:r a:m")
add("mcap csv", "timestamp,/imu.angular_velocity.x,/imu.angular_velocity.y,/imu.angular_velocity.z,/imu.linear_acceleration.x,/imu.linear_acceleration.y,/imu.linear_acceleration.z", "Ts w:r a:m")
add("px4 flat", "time_s;sensor_gyro_x;sensor_gyro_y;sensor_gyro_z;sensor_accel_x;sensor_accel_y;sensor_accel_z", "t w:r a:m", mark=";")
add("Betaflight units", "time (us), gyroADC[0] (deg/s), gyroADC[1] (deg/s), gyroADC[2] (deg/s), accSmooth[0] (g), accSmooth[1] (g), accSmooth[2] (g)", "tus w:d a:g", mark=", ")
add("German watch", "Zeitpunkt;Beschl_x_g;Beschl_y_g;Beschl_z_g;Drehrate_x_dps;Drehrate_y_dps;Drehrate_z_dps", "D a:g w:d", mark=";", edit=lambda line: line[:23] + line[23:].replace(".", ","))
add("German lab", "Zeit in s\tBeschleunigung in x in m/s\u00b2\tBeschleunigung in y in m/s\u00b2\tBeschleunigung in z in m/s\u00b2", "t a:m", mark="\t", edit=comma)
add("French lab", "t (s);ax (m.s-2);ay (m.s-2);az (m.s-2);gx (\u00b0/s);gy (\u00b0/s);gz (\u00b0/s)", "t a:m w:d", mark=";", edit=comma)
add("Italian 2", "Tempo;Accelerazione X;Accelerazione Y;Accelerazione Z;Velocit\u00e0 angolare X;Velocit\u00e0 angolare Y;Velocit\u00e0 angolare Z", "t a:m w:r", mark=";")
add("Portuguese 2", "Tempo (ms),Acelera\u00e7\u00e3o X (g),Acelera\u00e7\u00e3o Y (g),Acelera\u00e7\u00e3o Z (g),Girosc\u00f3pio X (\u00b0/s),Girosc\u00f3pio Y (\u00b0/s),Girosc\u00f3pio Z (\u00b0/s)", "tms a:g w:d")
add("Russian app", "\u0412\u0440\u0435\u043c\u044f (\u043c\u0441);\u0410\u043a\u0441\u0435\u043b\u0435\u0440\u043e\u043c\u0435\u0442\u0440 X (\u043c/\u0441\u00b2);\u0410\u043a\u0441\u0435\u043b\u0435\u0440\u043e\u043c\u0435\u0442\u0440 Y (\u043c/\u0441\u00b2);\u0410\u043a\u0441\u0435\u043b\u0435\u0440\u043e\u043c\u0435\u0442\u0440 Z (\u043c/\u0441\u00b2);\u0413\u0438\u0440\u043e\u0441\u043a\u043e\u043f X (\u0440\u0430\u0434/\u0441);\u0413\u0438\u0440\u043e\u0441\u043a\u043e\u043f Y (\u0440\u0430\u0434/\u0441);\u0413\u0438\u0440\u043e\u0441\u043a\u043e\u043f Z (\u0440\u0430\u0434/\u0441)", "tms a:m w:r", mark=";")
add("Chinese student", "\u65f6\u95f4(s),X\u8f74\u52a0\u901f\u5ea6(m/s\u00b2),Y\u8f74\u52a0\u901f\u5ea6(m/s\u00b2),Z\u8f74\u52a0\u901f\u5ea6(m/s\u00b2),X\u8f74\u89d2\u901f\u5ea6(rad/s),Y\u8f74\u89d2\u901f\u5ea6(rad/s),Z\u8f74\u89d2\u901f\u5ea6(rad/s)", "t a:m w:r")
add("Japanese Excel", "\u7d4c\u904e\u6642\u9593[ms],\u52a0\u901f\u5ea6X[mG],\u52a0\u901f\u5ea6Y[mG],\u52a0\u901f\u5ea6Z[mG],\u89d2\u901f\u5ea6X[deg/s],\u89d2\u901f\u5ea6Y[deg/s],\u89d2\u901f\u5ea6Z[deg/s]", "tms a:mg w:d")
add("Korean 2", "\uc2dc\uac04(ms),\uac00\uc18d\ub3c4X(g),\uac00\uc18d\ub3c4Y(g),\uac00\uc18d\ub3c4Z(g),\uac01\uc18d\ub3c4X(deg/s),\uac01\uc18d\ub3c4Y(deg/s),\uac01\uc18d\ub3c4Z(deg/s)", "tms a:g w:d")
add("misspelt", "time_ms,accelaration_x,accelaration_y,accelaration_z,gyroscop_x,gyroscop_y,gyroscop_z", "tms a:m w:r")
add("units by colon", "Time: s,Acc X: g,Acc Y: g,Acc Z: g", "t a:g")
add("dot axis", "time.ms;acc.x.mg;acc.y.mg;acc.z.mg;gyr.x.mdps;gyr.y.mdps;gyr.z.mdps", "tms a:mg w:md", mark=";")
add("excel serial time", "Date;Time;Accel X;Accel Y;Accel Z", "", lines=each(lambda k, t, a, w, m: f"01.05.2023;{MOM[k]:%H:%M:%S},{MOM[k].microsecond // 1000:03d};{comma(xyz(a, G, mark=';'))}"), want="a")
add("json rows of a phone", "", "", lines=lambda s: ["[" + ",".join('{"t": %.3f, "acc": {"x": %.5f, "y": %.5f, "z": %.5f}, "gyro": {"alpha": %.5f, "beta": %.5f, "gamma": %.5f}}' % (t, *s["a"][k], s["w"][k][2] / DEG, s["w"][k][0] / DEG, s["w"][k][1] / DEG) for k, t in enumerate(T)) + "]"], want="aw", file="log.json")
add("serial with unit words", "", "", lines=each(lambda k, t, a, w, m: f"Acceleration X: {a[0]:.4f}, Y: {a[1]:.4f}, Z: {a[2]:.4f} m/s^2  Rotation X: {w[0]:.5f}, Y: {w[1]:.5f}, Z: {w[2]:.5f} rad/s  t: {4321 + 10 * k} ms"), want="aw", file="log.txt")
add("mbed", "", "", lines=each(lambda k, t, a, w, m: f"t={4321 + 10 * k};A={xyz(a, mark=' ')};G={xyz(w, mark=' ')}"), want="aw", file="log.txt")
add("csv with units in cells", "Time,Acc X,Acc Y,Acc Z", "", lines=each(lambda k, t, a, w, m: f"{t:.2f} sec,{xyz(a)}"), want="a")
# --- a letter or a word for the place before that of the sensor
add("X all", "t,Xgx,Xgy,Xgz,Xax,Xay,Xaz,Xmx,Xmy,Xmz", "t w:d a:m m:uT")
add("X g m", "t,Xgx,Xgy,Xgz,Xmx,Xmy,Xmz", "t w:d m:uT")
add("X g a", "time,Xax,Xay,Xaz,Xgx,Xgy,Xgz", "t a:m w:r")
add("sg", "time,sax,say,saz,sgx,sgy,sgz", "t a:g w:d")
add("sg only", "time,sgx,sgy,sgz", "t w:d")
add("IMU1gx", "time,IMU1ax,IMU1ay,IMU1az,IMU1gx,IMU1gy,IMU1gz", "t a:m w:r")
add("IMU1gx two", "time,IMU1ax,IMU1ay,IMU1az,IMU1gx,IMU1gy,IMU1gz,IMU2ax,IMU2ay,IMU2az,IMU2gx,IMU2gy,IMU2gz", "t a:m w:r a:m w:r")
add("b_gx", "time,b_ax,b_ay,b_az,b_gx,b_gy,b_gz", "t a:m w:r")
add("raw_gx", "time,raw_ax,raw_ay,raw_az,raw_gx,raw_gy,raw_gz", "t a:m w:r")
add("Cgx", "time,Cax,Cay,Caz,Cgx,Cgy,Cgz,Cmx,Cmy,Cmz", "t a:g w:d m:uT")
add("Cgx Cmx", "time,Cgx,Cgy,Cgz,Cmx,Cmy,Cmz", "t w:d m:uT")
add("lgx rgx", "time,lax,lay,laz,lgx,lgy,lgz,rax,ray,raz,rgx,rgy,rgz", "t a:g w:d a:g w:d")
add("hgx", "ts,hax,hay,haz,hgx,hgy,hgz", "tms a:g w:d")
add("fgx", "ts,fax,fay,faz,fgx,fgy,fgz", "tms a:g w:d")
add("mpugx", "ts,mpuax,mpuay,mpuaz,mpugx,mpugy,mpugz", "tms a:g w:d")
add("mpu_gx", "ts,mpu_ax,mpu_ay,mpu_az,mpu_gx,mpu_gy,mpu_gz", "tms a:g w:d")
add("lsm_gx", "ts,lsm_ax,lsm_ay,lsm_az,lsm_gx,lsm_gy,lsm_gz", "tms a:g w:d")
add("bmigx", "ts,bmiax,bmiay,bmiaz,bmigx,bmigy,bmigz", "tms a:g w:d")
add("a1gx", "ts,a1x,a1y,a1z,g1x,g1y,g1z", "tms a:g w:d")
add("Xgyrx", "t,Xaccx,Xaccy,Xaccz,Xgyrx,Xgyry,Xgyrz", "t a:m w:r")
add("igx imx", "t,iax,iay,iaz,igx,igy,igz,imx,imy,imz", "t a:m w:r m:uT")
add("xgx", "t,xax,xay,xaz,xgx,xgy,xgz", "t a:m w:r")
add("gx_X", "t,ax_L,ay_L,az_L,gx_L,gy_L,gz_L,ax_R,ay_R,az_R,gx_R,gy_R,gz_R", "t a:m w:r a:m w:r")
add("gxL", "t,axL,ayL,azL,gxL,gyL,gzL", "t a:m w:r")
add("bgx are biases", "t,bgx,bgy,bgz,bax,bay,baz", "t n3 n3", refuse="no_sensor")
add("dgx", "t,ax,ay,az,dgx,dgy,dgz", "t a:m n3",want="a")
add("Wgx", "t,Wax,Way,Waz,Wgx,Wgy,Wgz", "t a:m w:r")
add("Agx", "t,Aax,Aay,Aaz,Agx,Agy,Agz,Bax,Bay,Baz,Bgx,Bgy,Bgz", "t a:m w:r a:m w:r")
add("wrist", "t,wristax,wristay,wristaz,wristgx,wristgy,wristgz", "t a:m w:r")
add("S1", "t,S1ax,S1ay,S1az,S1gx,S1gy,S1gz,S1mx,S1my,S1mz", "t a:m w:r m:uT")
add("S1g only", "t,S1gx,S1gy,S1gz", "t w:r")
add("Xgx only", "t,Xgx,Xgy,Xgz", "t w:r")
add("Xwx", "t,Xfx,Xfy,Xfz,Xwx,Xwy,Xwz", "t a:m w:r")
add("Xmx only", "t,Xmx,Xmy,Xmz", "t m:uT")
add("uGx", "t,uAx,uAy,uAz,uGx,uGy,uGz,uMx,uMy,uMz", "t a:m w:r m:uT")
# --- and after the mends of these, most of them headers that programs in public repositories write
add("foot and shank", "time,faccx,faccy,faccz,fgyrx,fgyry,fgyrz,saccx,saccy,saccz,sgyrx,sgyry,sgyrz,load", "tms a:g w:d A:g W:d k")
add("left and right", "timestamp,lax,lay,laz,lgx,lgy,lgz,rax,ray,raz,rgx,rgy,rgz", "tms a:g w:d A:g W:d")
add("hand of gestures", "group,label,rep_id,sample_idx,hAX,hAY,hAZ,hGX,hGY,hGZ,iAX,iAY,iAZ,iGX,iGY,iGZ,mAX,mAY,mAZ,mGX,mGY,mGZ", "s:throttle s:up n:1 i a:g w:d A:g W:d A:g W:d")
add("H3 beside an IMU", "Timestamp,H3_AX,H3_AY,H3_AZ,IMU_AX,IMU_AY,IMU_AZ,IMU_GX,IMU_GY,IMU_GZ,Lat,Lon,Fix", "tms A:g a:g w:d n:48 n:11 n:1")
add("raw and filt", "timestamp,raw_ax,raw_ay,raw_az,raw_gx,raw_gy,raw_gz,raw_mx,raw_my,raw_mz,raw_temp_c,filt_ax,filt_ay,filt_az,filt_gx,filt_gy,filt_gz,filt_mx,filt_my,filt_mz,filt_temp_c,q0,q1,q2,q3,roll,pitch,yaw", "tms a:m w:r m:uT tmp A:m W:r M:uT tmp q e")
add("diagnostics", "timestamp_us,dt_s,raw_ax,raw_ay,raw_az,raw_gx,raw_gy,raw_gz,roll_deg,pitch_deg,gx_dps,gy_dps,gz_dps,calibrated,valid", "tus n:0.01 a:g w:d p p w:d n:1 n:1")
add("ECG patch", "t_us,ecg_corr,ax0,ay0,az0,gx0,gy0,gz0,ax1,ay1,az1,gx1,gy1,gz1,ax2,ay2,az2,gx2,gy2,gz2,out_raw,refout_raw", "tus k a:g w:d A:g W:d A:g W:d k k")
add("tempo_us", "tempo_us,ax1,ay1,az1,gx1,gy1,gz1,ax2,ay2,az2,gx2,gy2,gz2", "tus a:c w:c A:c W:c", expect="counts")
add("load cell", "sample_us,time_of_day,load_cell_raw,load_cell_est_kg,imu_ax,imu_ay,imu_az,imu_gx,imu_gy,imu_gz,imu_mx,imu_my,imu_mz,roll_deg,pitch_deg,yaw_deg", "tus C k p a:m w:r m:uT e")
add("Raw_G of a calibration", "Sample,Raw_Gx,Raw_Gy,Raw_Gz,Temp_C", "i w:d tmp")
add("true, est, imu", "t,true_wx,true_wy,true_wz,est_wx,est_wy,est_wz,imu_ax,imu_ay,imu_az,imu_gx,imu_gy,imu_gz", "t W:r W:r a:m w:r")
add("headset raw gyro", "t,qw,qx,qy,qz,ax,ay,az,gx,gy,gz,rgt,rgx,rgy,rgz", "t q a:g w:r t W:r")
add("gaze", "TS,HR,LGX,LGY,LGZ,LGC,LPD,LPDC,RGX,RGY,RGZ,RGC,RPD,RPDC,CGX,CGY,CGZ,CGC,PPX,PPY,PPZ,PRX,PRY,PRZ", "Ts k u n:1 p n:1 u n:1 p n:1 u n:1 n3 e", refuse=True)
add("AV of two", "time,AccX1,AccY1,AccZ1,AVX1,AVY1,AVZ1,AccX2,AccY2,AccZ2,AVX2,AVY2,AVZ2,GpsLong,GpsLat,GpsHeight,GpsSpeed,GpsDecl", "t a:g w:d A:g W:d n:11 n:48 p p p")
add("AngVel of two", "Time,AccX1,AccY1,AccZ1,AccX2,AccY2,AccZ2,AngVelX1,AngVelY1,AngVelZ1,AngVelX2,AngVelY2,AngVelZ2,AngX1,AngY1,AngZ1,AngX2,AngY2,AngZ2", "t a:g A:g w:d W:d e e")
add("two ICM", "Time,AccX1,AccY1,AccZ1,GyroX1,GyroY1,GyroZ1,MagX1,MagY1,MagZ1,AccX2,AccY2,AccZ2,GyroX2,GyroY2,GyroZ2,MagX2,MagY2,MagZ2", "tms a:m w:r m:uT A:m W:r M:uT")
add("session of a watch", "SessionID,SessionDate,SessionDuration,SessionPeriod,AmountOfSensors,IsWalking,Timestamp1,timeIntervalSince1970_1,GyroX1,GyroY1,GyroZ1,AccX1,AccY1,AccZ1,MagX1,MagY1,MagZ1", "s:a D2 n:10 n:10 n:1 n:0 t Ts w:d a:g m:uT")
add("Timestamp1", "Timestamp1(ms),AccX1,AccY1,AccZ1,GyroX1,GyroY1,GyroZ1,Roll1,Pitch1,Yaw1", "tms a:g w:d e")
add("IMU1_Ax", "Timestamp,IMU1_Ax,IMU1_Ay,IMU1_Az,IMU1_Gx,IMU1_Gy,IMU1_Gz,IMU2_Ax,IMU2_Ay,IMU2_Az,IMU2_Gx,IMU2_Gy,IMU2_Gz", "Tms a:g w:d A:g W:d")
add("ADXL beside two", "ms,adxl_x,adxl_y,adxl_z,imu1_ax,imu1_ay,imu1_az,imu1_gx,imu1_gy,imu1_gz,imu2_ax,imu2_ay,imu2_az,imu2_gx,imu2_gy,imu2_gz,temp_c,press_hpa,alt_m,sensor_status", "tms A:m a:m w:r A:m W:r tmp p p n:7")
add("posture belt", "ms,imu1_ax,imu1_ay,imu1_az,imu1_gx,imu1_gy,imu1_gz,imu1_posture,imu2_ax,imu2_ay,imu2_az,imu2_gx,imu2_gy,imu2_gz,imu2_posture,combined_posture,flex_raw", "tms a:g w:d s:ok A:g W:d s:ok s:ok k")
add("robot arm", "timestamp,imu1_gvx,imu1_gvy,imu1_gvz,imu1_gx,imu1_gy,imu1_gz,imu1_qw,imu1_qx,imu1_qy,imu1_qz,imu1_quatAcc,imu1_lax,imu1_lay,imu1_laz,imu1_ax,imu1_ay,imu1_az,imu1_mx,imu1_my,imu1_mz", "Ts v:m w:r q n:3 f:m a:m m:uT")
add("chewing", "time_ms,l_ax,l_ay,l_az,l_gx,l_gy,l_gz,r_ax,r_ay,r_az,r_gx,r_gy,r_gz", "tms a:g w:d A:g W:d")
add("both hands", "L_F1,L_F2,L_F3,L_F4,L_F5,L_Ax,L_Ay,L_Az,L_Gx,L_Gy,L_Gz,R_F1,R_F2,R_F3,R_F4,R_F5,R_Ax,R_Ay,R_Az,R_Gx,R_Gy,R_Gz", "k k k k k a:g w:d k k k k k A:g W:d")
add("zip line", "time,L_Ax,L_Ay,L_Az,R_Ax,R_Ay,R_Az,Pulsos,Vel_ms", "tms a:g A:g k p")
add("three places", "Time,Ankle_acc_x,Ankle_acc_y,Ankle_acc_z,Thigh_acc_x,Thigh_acc_y,Thigh_acc_z,Trunk_acc_x,Trunk_acc_y,Trunk_acc_z,Label", "tms a:mg A:mg A:mg n:1")
add("w_x a_x", "time_ns,w_x,w_y,w_z,a_x,a_y,a_z,tx,ty,tz,qx,qy,qz,qw", "Tns w:r a:m n3 q")
add("race car observer", "t,roll,pitch,yaw,w_x,w_y,w_z,a_x,a_y,a_z,n_FL,n_FR,motor_pwm,servo_pwm,d_f,vhat_x,vhat_y,what_z", "Ts e w:r a:m k k k k p p p p")
add("robot of bricks", "seq,t_ms,phase,relA_deg,relB_deg,velL,velR,statusL,statusR,yaw_ddeg,accx_mg,accy_mg,accz_mg,reflC_pct,rC,gC,bC,iC", "i tms s:go p p p p n:0 n:0 p a:mg p k k k k")
add("tracker of a buoy", "unix_time,human_time,interval_s,lat_i,lon_i,alt_m,sats,accX_mg,accY_mg,accZ_mg,gyrX_dps,gyrY_dps,gyrZ_dps,magX_uT,magY_uT,magZ_uT,temp_C,press_Pa,baroAlt_m", "Ts D n:0.01 n:480000000 n:110000000 p n:9 a:mg w:d m:uT tmp p p")
add("CO2 balloon", "Time_ms,Pressure_hPa,BMP_Temp_C,Altitude_m,CO2_ppm,SCD30_Temp_C,SCD30_RH,AccX_mg,AccY_mg,AccZ_mg,GyroX_dps,GyroY_dps,GyroZ_dps,GPS_Lat,GPS_Lon,GPS_Alt_m,GPS_Sats", "tms p tmp p n:420 tmp p a:mg w:d n:48 n:11 p n:9")
add("roll rate apart", "Time_us,Gyro_X,Gyro_Y,Gyro_Z,Accel_X,Accel_Y,Accel_Z,Temp_C,Pressure_hPa,Alt_Raw_m,Velocity_ms,Roll_Angle_deg,Roll_Rate_degs,Tilt_deg,Pitch_Rate_degs,Yaw_Rate_degs", "", lines=each(lambda k, t, a, w, m: f"{7000000 + 10000 * k},{xyz(w, DEG)},{xyz(a, G)},25.1,1013.2,120.1,1.5,3.1,{w[0] / DEG:.4f},2.1,{w[1] / DEG:.4f},{w[2] / DEG:.4f}"), want="aw")
add("uncorrected beside", "time_us,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,temperature_c,gyro_sensor_uncorrected_x_rad_s,gyro_sensor_uncorrected_y_rad_s,gyro_sensor_uncorrected_z_rad_s", "tus w:r a:m tmp W:r")
add("gyro of a loop", "time_us,gyroX,gyroY,gyroZ", "tus w:d")
add("whale tag", "accelX,accelY,accelZ,gyroX,gyroY,gyroZ,magX,magY,magZ,red,green,blue,pressure(mBar),temperature,datetime", "a:g w:d m:uT k k k p tmp D")
add("Nmsg", "Nmsg,AccX,AccY,AccZ,GyroX,GyroY,GyroZ,AngX,AngY,Alt,Pressure,Temp,Parachute,Peripheral", "i a:g w:d p p p p tmp n:0 n:1")
add("time in four columns", "Processed,Time(h),Time(m),Time(s),Time(ms),Delt,AccX,AccY,AccZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ,PCTimestamp", "", lines=each(lambda k, t, a, w, m: f"1,{MOM[k].hour},{MOM[k].minute},{MOM[k].second},{MOM[k].microsecond // 1000},10,{xyz(a, G)},{xyz(w, DEG)},{xyz(m, 1e-6)},{E0 + t:.3f}"), want="awm")
add("hax of the head", "Time,Index,AccX,AccY,AccZ,MagnX,MagnY,MagnZ,GyroX,GyroY,GyroZ,qW,qX,qY,qZ,hax,hay,haz", "Tms i a:m m:uT w:r q f:m")
add("navigation states", "ts,x,y,z,vx,vy,vz,roll,pitch,yaw,bax,bay,baz,bgx,bgy,bgz,Lx,Ly,Lz", "Ts n3 n3 e b b n3", refuse=True)
add("Polish skates", "t_sec,label,pax,pay,paz,pzx,pzy,pzz,pmx,pmy,pmz,lax,lay,laz,lzx,lzy,lzz,lmx,lmy,lmz", "t s:jazda a:g w:d m:uT A:g W:d M:uT")
add("two boards", "SMX,SMY,SMZ,SAX,SAY,SAZ,SGX,SGY,SGZ,PMX,PMY,PMZ,PAX,PAY,PAZ,PGX,PGY,PGZ", "m:uT a:g w:d M:uT A:g W:d")
add("CSV first", "CSV,fax,fay,faz,fgx,fgy,fgz,sax,say,saz,sgx,sgy,sgz,fi,si", "s:CSV a:g w:d A:g W:d n:0 n:1")
add("orthosis", "timestamp_us,frame_index,fax,fay,faz,fgx,fgy,fgz,sax,say,saz,sgx,sgy,sgz,fqw,fqx,fqy,fqz,sqw,sqx,sqy,sqz,status", "tus i a:c w:c A:c W:c q q n:0", expect="counts")
add("device motion r", "elapsed,dm_ax,dm_ay,dm_az,dm_rx,dm_ry,dm_rz", "t a:g w:r")
add("smart ball", "t,A_x,A_y,A_z,Om_x,Om_y,Om_z", "t a:m w:r")
add("mps2 and dps", "epoch_s,AccelerationX_mps2,AccelerationY_mps2,AccelerationZ_mps2,AngularRateX_dps,AngularRateY_dps,AngularRateZ_dps", "Ts a:m w:d")
add("flight software", "MET,GYRO_RATE_X,GYRO_RATE_Y,GYRO_RATE_Z,ACC_MEAS_X,ACC_MEAS_Y,ACC_MEAS_Z", "t w:r a:m")
add("corrected gyro", "System Time,Corrected Gyro X,Corrected Gyro Y,Corrected Gyro Z,Corrected Accel X,Corrected Accel Y,Corrected Accel Z,Corrected Compass X,Corrected Compass Y,Corrected Compass Z", "t w:r a:g m:G")
add("plural sensors", "Time,Accelerometers X,Accelerometers Y,Accelerometers Z,Gyroscopes X,Gyroscopes Y,Gyroscopes Z,Magnetometers X,Magnetometers Y,Magnetometers Z", "t a:m w:r m:uT")
add("Norwegian", "tid;akselerasjon_x;akselerasjon_y;akselerasjon_z;vinkelhastighet_x;vinkelhastighet_y;vinkelhastighet_z", "t a:m w:r", mark=";")
add("Czech", "cas_ms;zrychleni_x;zrychleni_y;zrychleni_z;gyro_x;gyro_y;gyro_z", "tms a:g w:d", mark=";")
add("Finnish", "aika;kiihtyvyys_x;kiihtyvyys_y;kiihtyvyys_z;kulmanopeus_x;kulmanopeus_y;kulmanopeus_z", "t a:m w:r", mark=";")
add("lin, grav, rot", "millis;lin_ax;lin_ay;lin_az;grav_x;grav_y;grav_z;rot_x;rot_y;rot_z", "tms f:m v:m w:d", want="w", mark=";")
add("armband", "ms,emg1,emg2,emg3,emg4,emg5,emg6,emg7,emg8,Xa,Ya,Za,Xg,Yg,Zg", "tms k k k k k k k k a:g w:d")
add("axis first", "t,Xa,Ya,Za,Xg,Yg,Zg,Xm,Ym,Zm", "t a:m w:r m:uT")
add("axis in the middle", "t,a_X_L,a_Y_L,a_Z_L,w_X_L,w_Y_L,w_Z_L,a_X_R,a_Y_R,a_Z_R,w_X_R,w_Y_R,w_Z_R", "t a:m w:r A:m W:r")
add("S1 and S2 by number", "t,S1_acc_1,S1_acc_2,S1_acc_3,S1_gyr_1,S1_gyr_2,S1_gyr_3,S2_acc_1,S2_acc_2,S2_acc_3,S2_gyr_1,S2_gyr_2,S2_gyr_3", "t a:m w:r A:m W:r")
add("hip and knee", "Time,hipax,hipay,hipaz,hipgx,hipgy,hipgz,kneeax,kneeay,kneeaz,kneegx,kneegy,kneegz", "t a:g w:d A:g W:d")
add("pelvis with units", "Time[s],Pelvis A_x[m/s\u00b2],Pelvis A_y[m/s\u00b2],Pelvis A_z[m/s\u00b2],Pelvis W_x[\u00b0/s],Pelvis W_y[\u00b0/s],Pelvis W_z[\u00b0/s]", "t a:m w:d")
add("AUV", "t,imu/ax,imu/ay,imu/az,imu/p,imu/q,imu/r,dvl/u,dvl/v,dvl/w", "t a:m w:r n3")
add("DMP world", "t_ms\taworldX\taworldY\taworldZ\tgX\tgY\tgZ", "tms f:m w:d", want="w", mark="\t", file="log.txt")
add("sec and nanosec", "sec,nanosec,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,frame_id", "sec nsec w:r a:m s:imu_link")
add("biases with b_", "t,b_ax,b_ay,b_az,b_gx,b_gy,b_gz", "t b b", refuse=True)
add("biases of a gyro with b_", "t,b_gx,b_gy,b_gz", "t b", refuse=True)
add("errors", "t,ex,ey,ez,eax,eay,eaz,egx,egy,egz", "t n3 b b", refuse=True)
add("sigmas", "time,sax,say,saz,sgx,sgy,sgz", "t b b", refuse=True)
add("pose", "t,tx,ty,tz,ang_x,ang_y,ang_z", "t n3 e", refuse=True)
add("currents", "t,ia,ib,ic,ua,ub,uc", "t n3 n3", refuse=True)
add("sonic anemometer", "time,U_Axis,V_Axis,W_Axis,SonicTemp", "D n3 tmp", refuse=True)
add("average of x", "t,avgx,avgy,avgz,stdx,stdy,stdz", "t n3 b", refuse=True)
add("array of magnetometers", "t,m1x,m1y,m1z,m2x,m2y,m2z", "t m:uT M:uT")
add("H and heading", "t;Hx;Hy;Hz;Hdg", "t m:uT p", mark=";")
add("Fax and Fmx", "t,Fax,Fay,Faz,Fmx,Fmy,Fmz", "t a:g m:uT")
add("gyro of a key", "uptime_ms,k1gx,k1gy,k1gz,k1ax,k1ay,k1az,k2gx,k2gy,k2gz,k2ax,k2ay,k2az", "tms w:d a:g W:d A:g")
add("bow and fiddle", "t;bow.a.x;bow.a.y;bow.a.z;bow.g.x;bow.g.y;bow.g.z;vln.a.x;vln.a.y;vln.a.z;vln.g.x;vln.g.y;vln.g.z", "t a:g w:d A:g W:d", mark=";")
add("sat A and B", "epoch,A_wx,A_wy,A_wz,A_bx,A_by,A_bz,B_wx,B_wy,B_wz,B_bx,B_by,B_bz", "Ts w:r m:nT W:r M:nT")
# --- names that are alike but for a letter, of sensors and of other things
add("arm and leg", "t,arm_ax,arm_ay,arm_az,arm_gx,arm_gy,arm_gz,leg_ax,leg_ay,leg_az,leg_gx,leg_gy,leg_gz", "t a:m w:r A:m W:r")
add("counts of the left", "ms,Lax,Lay,Laz,Lgx,Lgy,Lgz", "tms a:c w:c", expect="counts")
add("points a and b", "t,pax,pay,paz,pbx,pby,pbz", "t n3 n3", refuse=True)
add("force plates", "t,LFx,LFy,LFz,LMx,LMy,LMz,RFx,RFy,RFz,RMx,RMy,RMz", "t n3 n3 n3 n3", refuse=True)
add("front and back", "t,axf,ayf,azf,axb,ayb,azb", "t a:g A:g")
add("x_acc_l", "t,x_acc_l,y_acc_l,z_acc_l,x_gyr_l,y_gyr_l,z_gyr_l", "t a:g w:d")
add("axis as a word", "Time,Acc X Axis,Acc Y Axis,Acc Z Axis,Gyro X Axis,Gyro Y Axis,Gyro Z Axis", "t a:g w:d")
add("s0 and s1", "t,s0_ax,s0_ay,s0_az,s0_gx,s0_gy,s0_gz,s1_ax,s1_ay,s1_az,s1_gx,s1_gy,s1_gz", "t a:m w:r A:m W:r")
add("player 1", "t,p1ax,p1ay,p1az,p1gx,p1gy,p1gz,p2ax,p2ay,p2az,p2gx,p2gy,p2gz", "t a:m w:r A:m W:r")
add("device 0", "t,d0ax,d0ay,d0az,d0gx,d0gy,d0gz,d0mx,d0my,d0mz", "t a:m w:r m:uT")
add("node A", "ts;A_ax;A_ay;A_az;A_gx;A_gy;A_gz;B_ax;B_ay;B_az;B_gx;B_gy;B_gz", "Ts a:m w:r A:m W:r", mark=";")
add("node G", "ts;G_ax;G_ay;G_az;G_gx;G_gy;G_gz;A_ax;A_ay;A_az;A_gx;A_gy;A_gz", "Ts a:m w:r A:m W:r", mark=";")
add("Kalman beside raw", "t,ax,ay,az,gx,gy,gz,kax,kay,kaz,kgx,kgy,kgz", "t a:m w:r A:m W:r")
add("jerk", "t,ax,ay,az,jx,jy,jz", "t a:m n3")
add("rotation vector", "t,ax,ay,az,rvx,rvy,rvz", "t a:m n3")
add("angular acceleration", "t,wx,wy,wz,alphax,alphay,alphaz", "t w:r n3")
add("insole", "time,L_acc_x,L_acc_y,L_acc_z,L_gyro_x,L_gyro_y,L_gyro_z,L_cop_x,L_cop_y,L_force,R_acc_x,R_acc_y,R_acc_z,R_gyro_x,R_gyro_y,R_gyro_z", "t a:g w:d p p p A:g W:d")
add("earbuds", "ts_us,lb_ax,lb_ay,lb_az,lb_gx,lb_gy,lb_gz,rb_ax,rb_ay,rb_az,rb_gx,rb_gy,rb_gz", "tus a:g w:d A:g W:d")
add("trailer", "t,ax_t,ay_t,az_t,gx_t,gy_t,gz_t", "t a:m w:r")
add("voltages of three axes", "t,Vx_mV,Vy_mV,Vz_mV", "t n3", refuse=True)
add("inner and outer", "t,inner_bx,inner_by,inner_bz,outer_bx,outer_by,outer_bz", "t m:nT M:nT")
add("tool down a hole", "time,toolGx,toolGy,toolGz,toolBx,toolBy,toolBz", "t a:g m:nT")
add("strains", "t,exx,eyy,ezz", "t n3", refuse=True)
add("imu.w", "ts,imu.w.x,imu.w.y,imu.w.z,imu.a.x,imu.a.y,imu.a.z", "Ts w:r a:m")
add("body frame", "GPS_sow,fx_b,fy_b,fz_b,wx_b,wy_b,wz_b", "tow a:m w:r")
add("thigh and shank by letter", "time,T_ax,T_ay,T_az,T_gx,T_gy,T_gz,S_ax,S_ay,S_az,S_gx,S_gy,S_gz", "t a:g w:d A:g W:d")
add("glued with units", "t,Lax_g,Lay_g,Laz_g,Lgx_dps,Lgy_dps,Lgz_dps,Rax_g,Ray_g,Raz_g,Rgx_dps,Rgy_dps,Rgz_dps", "t a:g w:d A:g W:d")
add("IMU1ax with units", "t,IMU1ax_mps2,IMU1ay_mps2,IMU1az_mps2,IMU1gx_radps,IMU1gy_radps,IMU1gz_radps", "t a:m w:r")
add("upper X", "TIME,XAX,XAY,XAZ,XGX,XGY,XGZ", "t a:m w:r")
add("device Y", "t,YAx,YAy,YAz,YGx,YGy,YGz", "t a:m w:r")
add("rear wheel", "t,rwax,rway,rwaz,rwgx,rwgy,rwgz", "t a:m w:r")
add("corners of a car", "t,acc_fl_x,acc_fl_y,acc_fl_z,acc_fr_x,acc_fr_y,acc_fr_z,gyr_cg_x,gyr_cg_y,gyr_cg_z", "t a:g A:g w:d")
add("head", "t,hax,hay,haz,hgx,hgy,hgz,hmx,hmy,hmz", "t a:m w:r m:uT")
add("helmet of words", "millis,helmetAccX,helmetAccY,helmetAccZ,helmetGyrX,helmetGyrY,helmetGyrZ,bikeAccX,bikeAccY,bikeAccZ", "tms a:g w:d A:g")
add("lower case words", "millis,helmetaccx,helmetaccy,helmetaccz,helmetgyrx,helmetgyry,helmetgyrz", "tms a:g w:d")
add("mag alone with a place", "t,noseBx,noseBy,noseBz,noseT", "t m:nT n:48000")
add("linear and rate of a place", "t,headlax,headlay,headlaz,headgx,headgy,headgz", "t f:m w:r", want="w")
add("unit vectors", "t,ux,uy,uz", "t u", refuse=True)
add("torques and forces", "t,tx,ty,tz,fx,fy,fz,load", "t n3 n3 k", refuse=True)
add("gyro of a foot only", "t,footgx,footgy,footgz", "t w:d")
add("magnet of a foot only", "t,footmx,footmy,footmz", "t m:uT")
add("three boards", "us,b1ax,b1ay,b1az,b1gx,b1gy,b1gz,b2ax,b2ay,b2az,b2gx,b2gy,b2gz,b3ax,b3ay,b3az,b3gx,b3gy,b3gz", "tus a:m w:r A:m W:r A:m W:r")
add("g and d", "time,gax,gay,gaz,ggx,ggy,ggz,dax,day,daz,dgx,dgy,dgz", "t a:g w:d A:g W:d")
# fmt: on


def build(case, kind):
    sig = MOTION[kind]
    cols = [c for token in case["spec"] for c in fields(token, sig)]
    mark = case["mark"]
    lines = [case.get("prefix", "") + mark.join(row) + case.get("suffix", "") for row in zip(*cols, strict=True)]
    if case.get("lines"):
        lines = case["lines"](sig)
    if case.get("edit"):
        lines = [case["edit"](line) for line in lines]
    header = case["header"]
    return header + ("\n" if header else "") + "\n".join(lines) + "\n"


def truth(case, sig):
    want = (
        case["want"] if case["want"] is not None else "".join(dict.fromkeys(t[0] for t in case["spec"] if re.match(r"[awm][xyz]{0,3}:", t)))
    )
    names = {"a": "accel", "w": "gyro", "m": "mag"}
    return {names[k]: sig[k] for k in want}


def options(text):
    """The options that a refusal or a finding names, as Python reads them; the rate is known to whoever recorded the log."""
    found = {}
    for name in ("columns", "units", "rate", "topics", "data"):
        for match in re.finditer(rf"\b{name}=(\{{[^}}]*\}}|'[^']*'|[\w.]+)", text):
            if match[1] == "HZ" or "..." in match[1]:
                continue
            try:
                value = ast.literal_eval(match[1])
                if name in ("columns", "units"):
                    found[name] = pairs(value, name) | found.get(name, {})
                else:
                    found.setdefault(name, value)
            except (ValueError, SyntaxError):  # an example, not an option to type
                continue
    if "rate=" in text:
        found.setdefault("rate", RATE)
    return found


def compare(log, true, rate=RATE, tolerance=5e-3):
    if abs(log.rate / rate - 1) > 0.005:
        return ("time", f"rate {log.rate:.6g}")
    for name in ("gyro", "accel", "mag"):
        got, tr = getattr(log, name), true.get(name)
        if (got is None) != (tr is None):
            return (name, f"{name} {'missing' if got is None else 'invented'}")
        if tr is not None:
            n = min(len(got), len(tr))
            if abs(n - len(tr)) > 3:
                return (name, f"{name} has {len(got)} rows")
            err = np.nanmax(np.abs(np.asarray(got)[:n] - tr[:n])) / np.abs(tr).max()
            if not err < tolerance:
                ratio = np.nanmedian(np.linalg.norm(got, axis=1)) / np.median(np.linalg.norm(tr, axis=1))
                return (name, f"{name} off {err:.3g}, ratio {ratio:.4g}")
    return None


def judge(path, case, sig):
    true, given = truth(case, sig), dict(case.get("given", {}))
    rate = case.get("rate", RATE)
    said = ""
    first = None
    known = case.get("known") or ({"accel": "6.103515625e-05 g", "gyro": f"{1 / 131:.12g} deg/s"} if case.get("expect") == "counts" else {})
    if case.get("hardiron"):
        true = {"mag": sig["m"] + 1e-6 * np.array([300, -250, 260])}
    for attempt in range(4):
        try:
            log = jaxcal.read(path, quiet=True, **given)
        except jaxcal.JaxcalError as error:
            said = str(error)
            first = first or f"refused [{error.code}] {said.partition(': ')[2]}"
            if case["refuse"]:
                return ("refused" if error.code == case["refuse"] or case["refuse"] is True else "badly refused"), first
            more = options(said)
            if known and "units" in more:
                more["units"] = {k: known[k] for k in more.get("units", {}) if k in known}
            if case.get("knows") and error.code in ("columns_unclear", "no_gravity") and "columns=" in said:
                more = case["knows"]
            new = {k: v for k, v in more.items() if given.get(k) != v}
            for k, v in new.items():
                given[k] = {**given.get(k, {}), **v} if isinstance(v, dict) else v
            if not new:
                return "stuck", first
            continue
        except Exception as error:
            return "TRACEBACK", repr(error)[:300]
        if case["refuse"]:
            return "wrong", f"read {[s for s in ('gyro', 'accel', 'mag') if getattr(log, s) is not None]} though it should be refused"
        if case.get("said") in log.codes:
            return "right", "said"
        wrong = compare(log, true, rate, case.get("tolerance", 5e-3))
        if wrong is None:
            return (
                "right" if attempt == 0 else "refused, out works" if not (first or "").startswith("loud") else "loud, mended"
            ), first or ""
        # loud?
        hit = [f for f in log.findings if f.kind.guess or f.severity]
        about = [
            f
            for f in hit
            if wrong[0] in (*f.subject, f.facts.get("quantity"), f.facts.get("sensor"))
            or (wrong[0] == "time" and f.code in ("rate_of_name", "slow_clock"))
            or f.code in ("roles", "strange", "gravity_free", "several_columns")
        ]
        if attempt or not about:
            return (
                "loud, not mended" if (first or "").startswith("loud") else "wrong after way out" if attempt else "wrong"
            ), f"{wrong[1]} | given {given} | {first or ''} | " + " ; ".join(map(str, hit))[:300]
        about.sort(
            key=lambda one: (wrong[0] not in one.subject, one.code != "assumed", f"{wrong[0]}=" not in str(one))
        )  # what is said of this sensor first
        first = f"loud: {wrong[1]} | {about[0]}"
        new = options(str(about[0]))
        if not new:
            return "loud, no option", first
        for k, v in new.items():
            given[k] = {**given.get(k, {}), **v} if isinstance(v, dict) else v
    return "stuck", first or ""


def outcomes(cases, room):
    """Case, kind of motion, outcome and what was said, for every case and motion."""
    for case in cases:
        for kind, sig in MOTION.items():
            path = pathlib.Path(room, case["file"])
            path.write_text(build(case, kind), encoding=case.get("encoding", "utf-8"))
            yield case, kind, *judge(path, case, sig)
            path.unlink()


def main():
    pattern = sys.argv[1] if len(sys.argv) > 1 else ""
    tally = collections.Counter()
    with tempfile.TemporaryDirectory() as room:
        for case, kind, out, said in outcomes([case for case in CASES if re.search(pattern, case["name"])], room):
            tally[out] += 1
            if out not in ("right", "refused") or pattern:
                print(f"{out:20s} {case['name']} ({kind}): {said[: 420 if not pattern else 1500]}")
    print(sum(tally.values()), dict(tally))


if __name__ == "__main__":
    main()
