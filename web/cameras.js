// Two cameras of this machine, through the browser.

import { pairOf } from "./photographs.js";

const WISHED = { width: { ideal: 640 }, height: { ideal: 480 } };

// Opens the first two: {frame, close}; `frame` waits for the next pair of images. Throws an Error with the
// reason for a failure.
export async function openCameras() {
  const { mediaDevices } = navigator;
  if (!mediaDevices) throw new Error("cameras: this browser gives them to pages of https and of this machine alone");
  const any = await mediaDevices.getUserMedia({ video: true }); // before the user agrees, devices have no names
  stop(any);
  const found = (await mediaDevices.enumerateDevices()).filter(({ kind }) => kind === "videoinput");
  if (found.length < 2) throw new Error(`cameras: got ${found.length}; accepts two`);

  const streams = await Promise.all(found.slice(0, 2).map(({ deviceId }) =>
    mediaDevices.getUserMedia({ video: { deviceId: { exact: deviceId }, ...WISHED } })));
  const videos = await Promise.all(streams.map(async (srcObject) => {
    const video = Object.assign(document.createElement("video"), { srcObject, muted: true });
    await video.play();
    return video;
  }));
  return { frame: () => frameOf(videos), close: () => streams.forEach(stop) };
}

const stop = (stream) => stream.getTracks().forEach((track) => track.stop());

async function frameOf(videos) {
  await new Promise((done) => videos[0].requestVideoFrameCallback(done));
  const parts = videos.map(({ videoWidth, videoHeight }) => [0, videoWidth, videoHeight]);
  return pairOf(videos, parts, parts[0][1], parts[0][2]);
}
