/* node tests/web.mjs FOLDER: opens FOLDER/splatshadow.html in headless Chromium, through its debugging pipe, and uses it
   as a visitor would. FOLDER/native.bin has the same pictures by a native build. Screenshots go to FOLDER. */

import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, readdirSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { resolve } from 'node:path';

const folder = resolve(process.argv[2]), profile = mkdtempSync(`${tmpdir()}/splatshadow-`);
const SCENES = ['blob', 'smoke', 'cloud', 'fire', 'scan', 'particles'], WIDTH = 320, HEIGHT = 240;
let passed = 0, failed = 0;

function check(right, what) {
    if (right) return ++passed;
    ++failed;
    console.log(`failed: ${what}`);
}

/* ------------------------------------------------------------------------------------------------------- Chromium */

const browser = spawn('chromium', ['--headless', '--no-sandbox', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync', '--remote-debugging-pipe',
    `--user-data-dir=${profile}`, 'about:blank'], {stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe']});
const waiting = new Map(), messages = [];
let number = 0, held = '', session;

browser.stdio[4].setEncoding('utf8').on('data', chunk => {
    const parts = (held + chunk).split('\0');
    held = parts.pop();
    for (const part of parts) {
        const answer = JSON.parse(part), wait = waiting.get(answer.id);
        if (wait) waiting.delete(answer.id), wait(answer);
        if (/consoleAPICalled|exceptionThrown|entryAdded/.test(answer.method)) messages.push(JSON.stringify(answer.params));
    }
});

function send(method, params = {}) {
    const id = ++number;
    browser.stdio[3].write(JSON.stringify({id, method, params, sessionId: session}) + '\0');
    return new Promise((done, fail) => waiting.set(id, answer => answer.error ? fail(new Error(
        `${method}: ${answer.error.message}`)) : done(answer.result)));
}

/* Evaluates an expression on the page, awaiting it if it is a promise. */
async function evaluate(expression) {
    const {result, exceptionDetails} = await send('Runtime.evaluate', {expression, awaitPromise: true, returnByValue: true});
    if (exceptionDetails) throw new Error(exceptionDetails.exception?.description ?? exceptionDetails.text);
    return result.value;
}

async function until(expression, what) {
    for (let i = 0; i < 600; ++i) {
        if (await evaluate(expression)) return check(true, what);
        await new Promise(done => setTimeout(done, 100));
    }
    throw new Error(`waited in vain: ${what}`);
}

async function screenshot(name) {
    const {data} = await send('Page.captureScreenshot', {format: 'png'});
    writeFileSync(`${folder}/${name}.png`, Buffer.from(data, 'base64'));
}

/* The float picture that the module holds. */
async function floats() {
    const coded = await evaluate(`(() => {
        const all = new Uint8Array(wasm.memory.buffer, wasm.web_rgba(), 16 * canvas.width * canvas.height);
        let coded = '';
        for (let i = 0; i < all.length; i += 8192) coded += String.fromCharCode(...all.subarray(i, i + 8192));
        return btoa(coded);
    })()`);
    const raw = Buffer.from(coded, 'base64');
    return new Float32Array(raw.buffer.slice(raw.byteOffset, raw.byteOffset + raw.length));
}

/* What the canvas shows, by way of one that is meant for reading. */
const pixels = () => evaluate(`(() => {
    const copy = document.createElement('canvas');
    copy.width = canvas.width, copy.height = canvas.height;
    const read = copy.getContext('2d', {willReadFrequently: true});
    read.drawImage(canvas, 0, 0);
    return [...read.getImageData(0, 0, copy.width, copy.height).data].join();
})()`);
const rested = what => until(`steps > 0 && !moved`, what);

/* ------------------------------------------------------------------------------------------------------- pictures */

const srgb = x => x <= 0.0031308 ? 12.92 * x : 1.055 * Math.pow(x, 1 / 2.4) - 0.055;

async function testPictures() {
    const raw = readFileSync(`${folder}/native.bin`), size = 4 * WIDTH * HEIGHT;
    const native = new Float32Array(raw.buffer, raw.byteOffset, raw.length / 4);
    for (let scene = 0; scene < SCENES.length; ++scene) {
        /* the loop has nothing to do until `change` is called again */
        await evaluate(`element('scene').value = '${scene}',
            choose().then(() => (moved = false, steps = PASSES, frame(0)))`);
        const here = await floats(), there = native.subarray(scene * size, (scene + 1) * size);
        const shown = (await pixels()).split(',').map(Number);
        let most = 0, apart = 0, code = 0;
        for (let i = 0; i < size; ++i) {
            most = Math.max(most, Math.abs(there[i]));
            apart = Math.max(apart, Math.abs(here[i] - there[i]));
            if (i % 4 < 3) code = Math.max(code, Math.abs(shown[i] - 255 * Math.min(Math.max(srgb(here[i]), 0), 1)));
        }
        check(most > 0 && apart <= 1e-4 * most, `${SCENES[scene]}: ${apart / most} of the maximum off the native picture`);
        check(code <= 1, `${SCENES[scene]}: a canvas code is off by ${code}`);
        await evaluate('change()');
        await rested(`${SCENES[scene]} at rest`);
        await screenshot(`scene_${SCENES[scene]}`);
    }
}

/* ---------------------------------------------------------------------------------------------------------- input */

async function drag(button, modifiers) {
    const {x, y} = await evaluate(`(() => { scrollTo(0, 0); const r = canvas.getBoundingClientRect();
        return {x: r.x + r.width / 2, y: r.y + r.height / 2}; })()`);
    const mouse = (type, dx, more) => send('Input.dispatchMouseEvent', {type, x: x + dx, y, modifiers, button, ...more});
    await mouse('mousePressed', 0, {clickCount: 1});
    for (let i = 1; i <= 5; ++i) await mouse('mouseMoved', 12 * i, {buttons: button === 'right' ? 2 : 1});
    await mouse('mouseReleased', 60, {clickCount: 1});
}

const differs = (a, b) => a.some((value, i) => value !== b[i]);

async function testInput() {
    const SHIFT = 8;
    await evaluate(`element('scene').value = '2', choose()`);
    await rested('the cloud at rest');
    let before = await floats();
    const changes = async (what, act) => {
        await act();
        await rested(`at rest after ${what}`);
        const after = await floats();
        check(differs(before, after), `${what} changes the picture`);
        before = after;
    };
    await changes('dragging', () => drag('left', 0));
    await changes('dragging with the right button', () => drag('right', 0));
    await changes('dragging with Shift', () => drag('left', SHIFT));
    await changes('the wheel', () => evaluate(`canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: 200, cancelable: true}))`));
    for (const key of ['ArrowLeft', 'ArrowUp', '+'])
        await changes(`the key ${key}`, () => evaluate(`canvas.dispatchEvent(new KeyboardEvent('keydown', {key: '${key}'}))`));
    await changes('Shift and an arrow', () => evaluate(
        `canvas.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', shiftKey: true}))`));
    await changes('quality', () => evaluate(`element('quality').value = '1', element('quality').dispatchEvent(new Event('change'))`));
    await evaluate(`element('budget').value = '25', element('budget').dispatchEvent(new Event('input'))`);
    check(await evaluate(`element('budget_text').textContent`) === '25 ms', 'the slider says its milliseconds');
    await rested('at rest after the slider');
    for (const size of [480, 320]) {
        await evaluate(`element('size').value = '${size}', element('size').dispatchEvent(new Event('change'))`);
        await rested(`at rest with ${size} columns`);
        check((await floats()).length === 4 * size * size * 3 / 4, `${size} columns of pixels`);
    }
    await evaluate(`element('quality').value = '2', element('quality').dispatchEvent(new Event('change'))`);
    await until('steps > CURVE_AFTER + 5', 'error and curve are measured'); /* a slow machine leaves ultra out */
    check(await evaluate(`curve.length >= 3 && /%|costly/.test(element('error').textContent)`), 'the error and the points of the curve');
    check(await evaluate(`element('plan').rows.length > 15`), 'the plan has a row for each pass');
}

/* Prints how long frames of the turning cloud take; the machine decides that, so it is no test. */
async function printMotion() {
    await evaluate(`element('scene').value = '2', element('budget').value = '60', choose()`);
    const frames = await evaluate(`(async () => {
        const all = [];
        for (let i = 0; i < 40; ++i) {
            turn(4, 0, false), moved = false;
            if (await frame(60)) all.push(JSON.parse(text(wasm.web_report())));
        }
        return all.slice(10).sort((a, b) => a.ms - b.ms);
    })()`);
    const middle = frames[frames.length >> 1];
    console.log(`the cloud in motion, within 60 ms: ${middle.ms.toFixed(0)} ms a frame (median of ${frames.length}), ` +
        `${middle.width} x ${middle.height} of ${WIDTH} x ${HEIGHT} pixels`);
    check(frames.length === 30 && middle.width <= WIDTH, 'the cloud turns');
}

/* ---------------------------------------------------------------------------------------------------------- files */

/* A ball of 24^3 bytes; `cut`: bytes that are missing at the end. */
function nrrd(cut) {
    const side = 24, voxels = Buffer.alloc(side ** 3);
    for (let i = 0; i < voxels.length; ++i)
        voxels[i] = Math.hypot(i % side - 11.5, Math.floor(i / side) % side - 11.5, Math.floor(i / side ** 2) - 11.5) < 9 ? 200 : 0;
    const header = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n\n`;
    return Buffer.concat([Buffer.from(header), voxels.subarray(0, voxels.length - cut)]).toString('base64');
}

/* 8^3 floats of one value. */
function npy(value) {
    const text = "{'descr': '<f4', 'fortran_order': False, 'shape': (8, 8, 8), }".padEnd(117) + '\n';
    const start = Buffer.from([0x93, ...Buffer.from('NUMPY'), 1, 0, text.length, 0]);
    return Buffer.concat([start, Buffer.from(text), Buffer.from(new Float32Array(512).fill(value).buffer)]).toString('base64');
}

const drop = (name, coded) => evaluate(`(() => {
    const dropped = new DataTransfer();
    dropped.items.add(new File([Uint8Array.from(atob('${coded}'), c => c.charCodeAt(0))], '${name}'));
    document.dispatchEvent(new DragEvent('drop', {dataTransfer: dropped, bubbles: true, cancelable: true}));
})()`);

async function refused(name, coded, sentence) {
    await drop(name, coded);
    await until(`${sentence}.test(element('sentence').textContent)`, `${name} gives a sentence`);
    const before = await floats();
    await evaluate('frame(0)');
    check(!differs(before, await floats()), `the scene stays after ${name}`);
    check(await evaluate(`element('scene').value === '2' && !stopped && opened.size === 0 && files.size === 0`),
          `nothing is left of ${name}`);
}

async function testFiles() {
    await evaluate('frame(0)');
    await refused('damaged.nrrd', nrrd(1000), '/damaged.nrrd: .*bytes/');
    await refused('notes.txt', Buffer.from('text').toString('base64'), '/notes.txt: not a/');
    await refused('large.nrrd', Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2000 2000 2000\nencoding: raw\n\n')
        .toString('base64'), '/large.nrrd: /');
    await refused('empty.vdb', Buffer.from('').toString('base64'), '/empty.vdb: /');
    await refused('rubbish.nvdb', Buffer.from('x'.repeat(5000)).toString('base64'), '/rubbish.nvdb: /');
    for (const [value, sentence] of [[NaN, '/some values/'], [3e38, '/some values/'], [-1, '/no voxel/'], [0, '/no voxel/']])
        await refused(`${value}.npy`, npy(value), sentence);
    await refused(`${'long name '.repeat(30)}cancelled by é.nrrd`, nrrd(10), '/cancelled by é.nrrd: /');
    const before = await floats();
    await drop('ball.nrrd', nrrd(0));
    await until(`element('scene').value === 'file' && steps > 0`, 'a dropped ball at rest');
    check(differs(before, await floats()), 'a dropped file is shown');
    check(await evaluate(`element('sentence').textContent`) === '', 'without a sentence');
    await screenshot('dropped');
    await testHead();
}

/* A real scan, through the form, with a header before its voxels. */
async function testHead() {
    const raw = `${process.env.SPLATSHADOW_DATA}/vismale_head_ct_128x128x256_u8.raw`, path = `${folder}/head.nrrd`;
    if (!existsSync(raw)) return console.log('skipped: a real scan: SPLATSHADOW_DATA does not say where it is');
    const header = 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 128 128 256\nspacings: 1.8 1.8 1\nencoding: raw\n\n';
    writeFileSync(path, Buffer.concat([Buffer.from(header), readFileSync(raw)]));
    const before = await floats(), {root} = await send('DOM.getDocument');
    const {nodeId} = await send('DOM.querySelector', {nodeId: root.nodeId, selector: '#file'});
    await send('DOM.setFileInputFiles', {nodeId, files: [path]});
    await until(`element('dropped').textContent === 'head.nrrd' && element('sentence').textContent === '' && steps > 0`, 'a real scan at rest');
    check(differs(before, await floats()), 'a real scan is shown');
    await screenshot('head');
}

/* ----------------------------------------------------------------------------------------- shaders that read maps */

/* Runs on the page: draws what the shader of a map returns at its points, and returns that, coded. */
function drawMap(info, glsl, coded) {
    const gl = globalThis.mapInk ??= document.createElement('canvas').getContext('webgl2');
    for (const name of ['EXT_color_buffer_float', 'OES_texture_float_linear'])
        if (!gl?.getExtension(name)) return `skipped: WebGL 2 without ${name}`;
    const all = Uint8Array.from(atob(coded), c => c.charCodeAt(0)), program = gl.createProgram();
    let at = 0;
    const [block, points, gas, surfaces] = info.bytes.map(count => all.slice(at, at += count).buffer);
    for (const [kind, text] of [[gl.VERTEX_SHADER, info.defines + info.vertex],
                                [gl.FRAGMENT_SHADER, info.defines + glsl + info.fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text), gl.compileShader(shader), gl.attachShader(program, shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) return gl.getShaderInfoLog(shader);
    }
    gl.linkProgram(program), gl.useProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return gl.getProgramInfoLog(program);
    const texture = (unit, target, filter, fill) => {
        gl.activeTexture(gl.TEXTURE0 + unit), gl.bindTexture(target, gl.createTexture()), fill();
        for (const name of [gl.TEXTURE_MAG_FILTER, gl.TEXTURE_MIN_FILTER]) gl.texParameteri(target, name, filter);
        for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
    };
    const array = (inner, outer, type, layers, data) => gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, inner, info.size[0],
        info.size[1], layers, 0, outer, type, data);
    const side = Math.sqrt(points.byteLength / 16), flat = data => gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, side, side,
        0, gl.RGBA, gl.FLOAT, data);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    texture(0, gl.TEXTURE_2D_ARRAY, gl.LINEAR, () => {
        if (info.format === 0) array(gl.RGBA32F, gl.RGBA, gl.FLOAT, info.size[2], new Float32Array(gas));
        else if (info.format === 1) array(gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT, info.size[2], new Uint16Array(gas));
        else array(gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, info.size[2], new Uint8Array(gas));
    });
    texture(1, gl.TEXTURE_2D_ARRAY, gl.NEAREST, () => info.half
        ? array(gl.R16F, gl.RED, gl.HALF_FLOAT, info.faces, new Uint16Array(surfaces))
        : array(gl.R32F, gl.RED, gl.FLOAT, info.faces, new Float32Array(surfaces)));
    texture(3, gl.TEXTURE_2D, gl.NEAREST, () => flat(new Float32Array(points)));
    texture(2, gl.TEXTURE_2D, gl.NEAREST, () => flat(null));
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gl.getParameter(gl.TEXTURE_BINDING_2D), 0);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 2, gl.createBuffer());
    gl.bufferData(gl.UNIFORM_BUFFER, block, gl.STATIC_DRAW);
    gl.uniformBlockBinding(program, gl.getUniformBlockIndex(program, 'tmap_block'), 2);
    for (const [name, unit] of [['tmap_gas', 0], ['tmap_surfaces', 1], ['points', 3]])
        gl.uniform1i(gl.getUniformLocation(program, name), unit);
    gl.uniform4fv(gl.getUniformLocation(program, 'light'), info.light);
    gl.viewport(0, 0, side, side), gl.drawArrays(gl.TRIANGLES, 0, 3);
    const got = new Float32Array(4 * side * side);
    gl.readPixels(0, 0, side, side, gl.RGBA, gl.FLOAT, got);
    const error = gl.getError();
    return error ? `error ${error}` : {coded: btoa(String.fromCharCode(...new Uint8Array(got.buffer)))};
}

/* Draws each map of FOLDER/map_N.bin into got_N.bin, which test_map_shaders.c judges. */
async function drawMaps() {
    const glsl = readFileSync('examples/shaders/transmittance_map.glsl', 'utf8');
    for (const name of readdirSync(folder).filter(name => /^map_\d+\.bin$/.test(name))) {
        const all = readFileSync(`${folder}/${name}`), end = all.indexOf(10), info = JSON.parse(all.subarray(0, end).toString());
        const coded = all.subarray(end + 1).toString('base64');
        const got = await evaluate(`(${drawMap})(${JSON.stringify(info)}, ${JSON.stringify(glsl)}, '${coded}')`);
        check(got.coded, `${name} in WebGL 2: ${got}`);
        if (got.coded) writeFileSync(`${folder}/${name.replace('map', 'got')}`, Buffer.from(got.coded, 'base64'));
    }
}

/* Asking is a message in the console. */
async function saysWgsl() {
    const has = await evaluate(`navigator.gpu?.requestAdapter().then(adapter => !!adapter) ?? false`);
    console.log(has ? 'not tested: the shaders in WGSL, although there is an adapter'
                    : 'skipped: the shaders in WGSL: this browser has no adapter for WebGPU');
}

/* --------------------------------------------------------------------------------------------------------- layout */

async function testLayout() {
    await evaluate(`element('scene').value = '0', choose()`);
    for (const [width, scheme] of [[1280, 'light'], [1280, 'dark'], [360, 'light'], [360, 'dark']]) {
        await send('Emulation.setDeviceMetricsOverride', {width, height: 800, deviceScaleFactor: 1, mobile: false});
        await send('Emulation.setEmulatedMedia', {features: [{name: 'prefers-color-scheme', value: scheme}]});
        check(await evaluate(`document.scrollingElement.scrollWidth <= ${width}`), `the page fits into ${width} pixels`);
        await until('steps > 2', `at rest at ${width} pixels`);
        await screenshot(`page_${width}_${scheme}`);
    }
}

try {
    const {targetInfos} = await send('Target.getTargets');
    const {targetId} = targetInfos.find(target => target.type === 'page');
    session = (await send('Target.attachToTarget', {targetId, flatten: true})).sessionId;
    for (const domain of ['Page', 'Runtime', 'Log', 'DOM']) await send(`${domain}.enable`);
    check(statSync(`${folder}/splatshadow.html`).size <= 3e6, 'the page has at most 3 MB');
    await send('Page.navigate', {url: `file://${folder}/splatshadow.html`});
    await until(`typeof steps === 'number' && steps > 0`, 'the page renders');
    await testPictures();
    await testInput();
    await printMotion();
    await testFiles();
    await drawMaps();
    await testLayout();
    check(messages.length === 0, `the console has messages: ${messages.slice(0, 3).join(' ')}`);
    await saysWgsl();
} catch (error) {
    check(false, error.stack);
}
browser.kill();
browser.on('exit', () => {
    rmSync(profile, {recursive: true, force: true, maxRetries: 5});
    console.log(`${passed} passed, ${failed} failed`);
    process.exit(failed > 0 ? 1 : 0);
});
